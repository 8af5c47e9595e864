"""How wrong is it, without a truth: samples predicted by their neighbours, weighed as the energy error weighs.

    E = mean over theta_i of  sum |g' - g| V / sum g V,   V = the solid angles squared that a sample stands for

V from the distance to its 8th neighbour in the stretched coordinates, so that nothing need be known of how the
samples were drawn.
"""

import numpy as np
from scipy.spatial import cKDTree

from gonio.geometry import Array
from gonio.reconstruct.splines.frame import Coordinates, PairAngles

LEAST = 0.2  # of the error is kept, however much of it noise explains
INCIDENCES = np.radians(np.array([0, 10, 20, 30, 40, 50, 60, 70, 78, 90]))


class EnergyError:
    """The energy error of predicted values at the samples `test` (indices), each left out of its own prediction."""

    def __init__(self, a: PairAngles, g: Array, sigma: Array, stretch: Coordinates, test):
        v = solid_angles(stretch, a, test)
        self._g, self._weight = g[test], energy_weights(a.at(test), g[test], v)
        # what the readings' own noise adds to |said - g|, the mean of a normal variable's magnitude
        self._noise = np.sqrt(2 / np.pi) * float((sigma[test] * self._weight).sum())

    def __call__(self, said: Array) -> float:
        """said (len(test), C): g = f cos(theta_o) as predicted."""
        error = float((np.abs(said - self._g) * self._weight).sum())
        noise = min(self._noise / max(error, 1e-300), 1.0)
        return error * float(np.sqrt(max(1 - noise**2, LEAST**2)))

    def of_errors(self, errors: Array) -> float:
        """The energy error of samples that are wrong by `errors` (len(test), C), no noise in them."""
        return float((errors * self._weight).sum())


def solid_angles(stretch: Coordinates, a: PairAngles, test) -> Array:
    """V of the samples `test`, up to a factor."""
    x = stretch(a)[:, :-1]
    distance, _ = cKDTree(x).query(x[test], min(9, len(x)))
    v = distance[:, -1] ** stretch.dimensions * stretch.measure(a.at(test))
    return np.minimum(v, 20 * np.mean(v))


def energy_weights(a: PairAngles, g: Array, v: Array) -> Array:
    """w (N, C) such that sum_n w |error of g_n| over n and channels is the mean energy error."""
    bin_ = np.clip(np.searchsorted(-np.cos(INCIDENCES), -a.cos_i) - 1, 0, len(INCIDENCES) - 2)
    energy = np.maximum(g, 0) * v[:, None]
    total = np.stack([np.bincount(bin_, e, len(INCIDENCES) - 1) for e in energy.T], 1)
    weight = v[:, None] / np.where(total > 0, total, np.inf)[bin_]
    return weight / np.maximum(np.count_nonzero(total, axis=0), 1) / g.shape[1]
