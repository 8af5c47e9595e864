"""Draws that keep away from each other and yet have the probabilities they were given: the local pivotal method.

Two units that lie near each other fight: the probability of both is kept, but one of them ends with as much of it as
goes (Grafstroem, Lundstroem & Schelin 2012, Spatially balanced sampling through the pivotal method, Biometrics 68).
Each unit is drawn with exactly its probability; neighbours are hardly ever drawn together.
"""

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array

NEIGHBOURS = 24  # looked up at once; who has outlived all of them looks again
SURE = 1e-9


def pivotal(x: Array, p: Array, rng: np.random.Generator) -> NDArray[np.int64]:
    """Indices of the units drawn: unit k of probability p[k] in [0, 1], at x (N, d). As many as p sums to, rounded up
    or down at random."""
    from scipy.spatial import cKDTree

    p = np.array(p, float)
    index = np.flatnonzero((p > SURE) & (p < 1 - SURE))
    if len(index) == 0:
        return np.flatnonzero(p > 0.5)
    share, points = p[index], x[index]
    left = np.ones(len(index), bool)
    queue = rng.permutation(len(index))
    while len(queue) > 1:
        tree = cKDTree(points[queue])
        near = queue[tree.query(points[queue], min(NEIGHBOURS, len(queue)))[1]]
        _fight(share, left, dict(zip(queue.tolist(), near.tolist())), queue.tolist(), rng.random(len(queue)).tolist())
        queue = queue[left[queue]]
    if len(queue) == 1:
        share[queue] = float(rng.random() < share[queue[0]])
    p[index] = share
    return np.flatnonzero(p > 0.5)


def _fight(share: Array, left, near: dict[int, list[int]], order: list[int], coins: list[float]) -> None:
    """Every unit of `order` fights the nearest that is left of its neighbours, until it or all of them are settled."""
    p, alive = share.tolist(), left.tolist()
    coin = iter(coins)  # a fight settles at least one unit: there are never more of them than units
    for i in order:
        for j in near[i]:
            if not alive[i]:
                break
            if j == i or not alive[j]:
                continue
            p[i], p[j] = _outcome(p[i], p[j], next(coin))
            alive[i], alive[j] = SURE < p[i] < 1 - SURE, SURE < p[j] < 1 - SURE
    share[:], left[:] = p, alive


def _outcome(a: float, b: float, coin: float) -> tuple[float, float]:
    """Probabilities after a fight: their sum and the expectation of each are what they were, one of them 0 or 1."""
    both = a + b
    if both < 1:
        return (0.0, both) if coin * both < b else (both, 0.0)
    return (1.0, both - 1) if coin * (2 - both) < 1 - b else (both - 1, 1.0)
