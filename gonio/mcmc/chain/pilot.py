"""A first look at the material: about a hundred fixed directions, close together where a glossy peak would be."""

import numpy as np

from gonio.geometry import Array, above_horizon, from_half_diff

THETA_H = np.concatenate([[0.0], np.radians(np.geomspace(0.06, 80, 24))])
THETA_D = np.radians([12.0, 34.0, 56.0, 72.0])
GOLDEN = 0.6180339887498949


def pilot_directions(anisotropic: bool) -> tuple[Array, Array, Array]:
    """wi, wo (N, 3) above the horizon and log_q (N,).

    theta_h log-spaced, a few theta_d, the azimuths spread by the golden ratio. exp(-log_q) / N is the share of the
    measure dwi dwo that a node stands for (a quadrature), as if the node had been drawn with that density.
    """
    th, td = (a.ravel() for a in np.meshgrid(THETA_H, THETA_D, indexing="ij"))
    k = np.arange(len(th))
    phi_d = np.pi * ((0.5 + GOLDEN * k) % 1)
    phi_h = 2 * np.pi * ((0.25 + GOLDEN**2 * 7 * k) % 1) if anisotropic else np.zeros(len(k))
    wi, wo = from_half_diff(th, phi_h, td, phi_d)
    # cells end half-way between nodes: in log theta_h, and in sin^2 theta_d, in which the measure is flat
    edges = np.concatenate([[0.0], np.sqrt(np.maximum(THETA_H[:-1], 0.03e-2) * THETA_H[1:]), [np.pi / 2]])
    cap = np.diff(-np.cos(edges))
    s = np.sin(THETA_D) ** 2
    share = np.diff(np.concatenate([[0.0], 0.5 * (s[1:] + s[:-1]), [1.0]]))
    # ∫ 4 cos sin dtheta_d over all is 2: solid angles of h and d give 2 pi and pi or 2 pi of azimuth besides
    measure = np.outer(cap, 2 * share).ravel() * 4 * np.pi**2
    keep = above_horizon(wi, wo) & (np.minimum(wi[:, 2], wo[:, 2]) > 0.02)
    return wi[keep], wo[keep], -np.log(measure[keep] * keep.sum())
