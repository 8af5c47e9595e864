"""Points that fill holes: each pick is the one farthest from all there are, by the size a hole should have there.

Greedy farthest points (Gonzalez 1985; Kennard & Stone 1969), distances weighted: where points are wanted densely a
small hole counts as much as a large one elsewhere.
"""

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array


def fill(x: Array, weight: Array, count: int, occupied: Array) -> NDArray[np.int64]:
    """Indices of `count` of the candidates x (M, d), in the order picked: largest weight times distance to what is
    occupied (N, d) or was picked before. weight (M,): the inverse of the spacing that is wanted there."""
    from scipy.spatial import cKDTree

    count = min(count, len(x))
    square = weight**2
    distance = np.full(len(x), np.inf) if len(occupied) == 0 else cKDTree(occupied).query(x)[0] ** 2
    score = square * distance
    picked = np.empty(count, np.int64)
    for k in range(count):
        picked[k] = i = int(np.argmax(score))
        z = x - x[i]
        np.minimum(score, square * np.einsum("nd,nd->n", z, z), out=score)
        score[i] = -1.0
    return picked
