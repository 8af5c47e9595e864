"""Readings that no neighbour bears out: a cosmic ray, a reflection off the stand, a slipped decimal."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gonio.geometry import Array

NEIGHBOURS = 12
FAR, WIDE = 1.8, 6.0
MOST = 50_000


def outliers(x: Array, y: Array, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Where y (N, C) lies further above its neighbours' median than 1.8 + 6 of their median deviations, (N,).

    1.8 in a log ratio is a factor 6. On a peak that the base misses neighbours differ as much, and nothing is marked.
    Only readings too bright: a log ratio cannot fall far (see `residual`), so a dark one does little harm.
    """
    among = rng.permutation(len(x))[:MOST]
    k = min(NEIGHBOURS + 1, len(among))
    tree, marked = cKDTree(x[among]), np.zeros(len(x), bool)
    for start in range(0, len(x), MOST):
        part = slice(start, start + MOST)
        _, near = tree.query(x[part], k)
        around = y[among[near]]  # the sample itself is one of thirteen: the median does not mind
        middle = np.median(around, 1)
        deviation = 1.4826 * np.median(np.abs(around - middle[:, None]), 1)
        marked[part] = (y[part] - middle > FAR + WIDE * deviation).any(1)
    return marked
