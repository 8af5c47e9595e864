"""How wrong is it, without a truth: every sample foretold by its neighbours, weighed as the energy error weighs.

    E = mean over theta_i of  sum |g' - g| V / sum g V,   V = the solid angles squared that a sample stands for

V from the distance to its 8th neighbour in the stretched coordinates, so that nothing need be known of how the
samples were drawn.
"""

import numpy as np
from scipy.spatial import cKDTree

from gonio.geometry import Array
from gonio.reconstruct.robust_base import Angles
from gonio.reconstruct.stretch import Stretch

INCIDENCES = np.radians(np.array([0, 10, 20, 30, 40, 50, 60, 70, 78, 90]))


def solid_angles(stretch: Stretch, a: Angles) -> Array:
    """V of each sample, (N,), up to a factor."""
    x = stretch(a)[:, :4]
    distance, _ = cKDTree(x).query(x, min(9, len(x)))
    v = distance[:, -1] ** 3 * stretch.measure(a)
    return np.minimum(v, 20 * np.mean(v))


def energy_weights(a: Angles, g: Array, v: Array) -> Array:
    """w (N, C) such that sum_n w |relative error of g_n| is the energy error of each channel over C."""
    theta_i = np.arctan2(np.sqrt(np.maximum(0, 1 - a.cos_i**2)), a.cos_i)
    bin_ = np.clip(np.searchsorted(INCIDENCES, theta_i) - 1, 0, len(INCIDENCES) - 2)
    energy = np.maximum(g, 0) * v[:, None]
    total = np.stack([np.bincount(bin_, e, len(INCIDENCES) - 1) for e in energy.T], 1)
    weight = v[:, None] / np.where(total > 0, total, np.inf)[bin_]
    return weight / (g.shape[1] * np.count_nonzero(total.sum(1)))
