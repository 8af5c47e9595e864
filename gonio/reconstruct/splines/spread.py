"""How far off each value may be: the held-out residuals of the samples around it, scaled so that 68 % lie within."""

import numpy as np
from scipy.spatial import cKDTree

from gonio.geometry import Array

NEIGHBOURS = 8
INSIDE = 0.6827


class Spread:
    """sd of the log ratio y at stretched coordinates (M, d), (M, C), from residuals (N, C) at samples x (N, d)."""

    def __init__(self, x: Array, residual: Array, variance: Array):
        # a held-out sample misses its prediction by the error of that and by its own noise: only the first is wanted
        square = np.maximum(residual**2 - variance[:, None], 0.1 * residual**2)
        self._tree, self._square = cKDTree(x), np.minimum(square, 9)
        k = min(NEIGHBOURS + 1, len(x))
        _, near = self._tree.query(x, k)
        others = np.sqrt(self._square[near[:, 1:]].mean(1)) + 1e-4
        self.scale = np.quantile(np.sqrt(square) / others, INSIDE, axis=0)

    def __call__(self, x: Array) -> Array:
        k = min(NEIGHBOURS, self._tree.n)
        _, near = self._tree.query(x, k)
        near = near.reshape(len(x), k)
        return self.scale * (np.sqrt(self._square[near].mean(1)) + 1e-4)
