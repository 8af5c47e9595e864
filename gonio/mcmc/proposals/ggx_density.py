"""Densities of wo given wi, many GGX lobes at once: what VNDF proposals and mixtures of them are made of."""

import numpy as np

from gonio.geometry import Array, directions, half_vector

LOG_4PI = np.log(4 * np.pi)


def log_vndf(wi: Array, wo: Array, alpha_x: Array | float, alpha_y: Array | float) -> Array:
    """log of D_wi(h) / (4 wo.h) = log of D(h) G1(wi) / (4 cos theta_i), (N, K) for (N, 3) pairs and (K,) lobes.

    The pdf in solid angle of wo of the GGX normals visible from wi (Heitz 2018). G1 / cos theta_i is written as
    2 / (cos theta_i + |alpha wi|): no division by a cosine near 0.
    """
    wi, wo = directions(wi), directions(wo)
    h = half_vector(wi, wo)
    ax, ay = np.atleast_1d(np.asarray(alpha_x, float)), np.atleast_1d(np.asarray(alpha_y, float))
    slope = (h[:, 0:1] / ax) ** 2 + (h[:, 1:2] / ay) ** 2 + h[:, 2:3] ** 2
    stretched = np.sqrt((wi[:, 0:1] * ax) ** 2 + (wi[:, 1:2] * ay) ** 2 + wi[:, 2:3] ** 2)
    return -LOG_4PI - np.log(ax * ay) - 2 * np.log(slope) + np.log(2 / (wi[:, 2:3] + stretched))
