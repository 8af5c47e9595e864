"""Readings that no neighbour bears out: a cosmic ray, a reflection off the stand, a slipped decimal."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gonio.geometry import Array

NEIGHBOURS = 12
FAR, WIDE = 1.8, 6.0


def outliers(x: Array, y: Array) -> NDArray[np.bool_]:
    """Where y (N, C) lies further above its neighbours' median than 1.8 + 6 of their median deviations, (N,).

    1.8 in a log ratio is a factor 6. On a peak that the base misses neighbours differ as much, and nothing is marked.
    Only readings too bright: a log ratio cannot fall far (see `residual`), so a dark one does little harm.
    """
    k = min(NEIGHBOURS + 1, len(x))
    _, near = cKDTree(x).query(x, k)
    around = y[near[:, 1:]]
    middle = np.median(around, 1)
    deviation = 1.4826 * np.median(np.abs(around - middle[:, None]), 1)
    return (y - middle > FAR + WIDE * deviation).any(1)
