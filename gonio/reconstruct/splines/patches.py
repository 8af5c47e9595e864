"""Scattered data interpolated smoothly by many small thin-plate splines that overlap (partition of unity).

Around each of P centres the K nearest samples carry one spline, y(x) = sum_k c_k (-|x - x_k|) + a + b.x with nugget:
the biharmonic kernel of three dimensions, the interpolant of least bending energy (Duchon 1977; Wendland 2004, ch. 8
and 15.4 for the blend). A query is the weighted mean of its nearest patches, weights falling to 0 at the first patch
left out, so that the result is continuous. Cost O(N log N): P ~ N/6 systems of fixed size, 3 channels = 3 right-hand
sides. The nugget of a sample is its noise variance over the patch's own variance, so that exact data are followed and
noisy ones averaged.
"""

import numpy as np
from scipy.spatial import cKDTree

from gonio.geometry import Array

BLEND = 3
BEYOND = 1 / 3
MOST = 60_000


class Patches:
    """y(x) for x (M, d): built from X (N, d), y (N, C) and the noise variance of y, (N,)."""

    def __init__(self, x: Array, y: Array, variance: Array, neighbours: int = 50, per_centre: float = 6.0):
        n, d = x.shape
        k = min(neighbours, n)
        centres = min(n, max(8, int(np.ceil(n / per_centre))), MOST)
        # every so many-th sample in a space-filling order: centres as dense as the data, without clumps
        order = _bisection_order(x)
        pick = order[(np.arange(centres) * n) // centres]
        self.centres = x[pick]
        self._tree = cKDTree(self.centres)
        distance, self._members = cKDTree(x).query(self.centres, k)
        self.scale = np.maximum(distance[:, -1], 1e-9)
        self._x = x
        self.coefficients = np.empty((centres, k + d + 1, y.shape[1]))
        for part in _chunks(centres, 2000):
            a, rhs = _system(x, y, variance, self.centres[part], self._members[part], self.scale[part])
            self.coefficients[part] = np.linalg.solve(a, rhs)
        # beyond the data the linear part would run away: no patch says more than its samples and a third of their range
        lowest, highest = y[self._members].min(1), y[self._members].max(1)
        self._lowest = lowest - BEYOND * (highest - lowest)
        self._highest = highest + BEYOND * (highest - lowest)

    def __call__(self, q: Array) -> Array:
        """(M, C). Patch by patch, each for all queries that it has a say in: few large products, not many small."""
        q = np.asarray(q, float)
        blend = min(BLEND, len(self.centres) - 1)
        distance, patch = self._tree.query(q, blend + 1)
        weight = np.maximum(1 - distance[:, :-1] / np.maximum(distance[:, -1:], 1e-12), 1e-9) ** 2
        weight = (weight / weight.sum(1, keepdims=True)).ravel()
        order = np.argsort(patch[:, :-1].ravel(), kind="stable")
        used, start = np.unique(patch[:, :-1].ravel()[order], return_index=True)
        k = self._members.shape[1]
        said = np.empty((len(order), self.coefficients.shape[2]))
        for p, mine in zip(used, np.split(order, start[1:])):
            # float32 is enough once centre and scale are out: 1e-6 of a patch's own variation
            z = ((q[mine // blend] - self.centres[p]) / self.scale[p]).astype(np.float32)
            x = ((self._x[self._members[p]] - self.centres[p]) / self.scale[p]).astype(np.float32)
            square = (-2 * z) @ x.T
            square += np.einsum("nd,nd->n", z, z)[:, None]
            square += np.einsum("nd,nd->n", x, x)
            np.sqrt(np.maximum(square, 0, out=square), out=square)
            c = self.coefficients[p]
            value = c[k] + z @ c[k + 1 :] - square @ c[:k].astype(np.float32)
            said[mine] = np.minimum(np.maximum(value, self._lowest[p]), self._highest[p])
        return (said * weight[:, None]).reshape(len(q), blend, -1).sum(1)


def left_out(x: Array, y: Array, variance: Array, at: Array, neighbours: int = 40) -> Array:
    """What the local spline says at samples `at` (indices) without them, (len(at), C): Rippa's formula (1999)."""
    k = min(neighbours, len(x))
    out = np.empty((len(at), y.shape[1]))
    tree = cKDTree(x)
    for part in _chunks(len(at), 2000):
        i = at[part]
        distance, members = tree.query(x[i], k)
        members = _self_first(members, i)
        scale = np.maximum(distance[:, -1], 1e-9)
        a, rhs = _system(x, y, variance, x[i], members, scale)
        unit = np.zeros((*a.shape[:2], 1))
        unit[:, 0] = 1
        inverse = np.linalg.solve(a, unit)[..., 0]  # a is symmetric: its inverse's first row
        out[part] = y[i] - np.einsum("nk,nkc->nc", inverse, rhs) / inverse[:, :1]
    return out


def _system(x: Array, y: Array, variance: Array, centre: Array, members, scale: Array) -> tuple[Array, Array]:
    p, k = members.shape
    z = (x[members] - centre[:, None]) / scale[:, None, None]
    d = z.shape[2]
    square = (z**2).sum(-1)
    r = square[:, :, None] + square[:, None] - 2 * z @ z.transpose(0, 2, 1)
    r = np.sqrt(np.maximum(r, 0))
    ys = y[members]
    spread = ((ys - ys.mean(1, keepdims=True)) ** 2).mean((1, 2))
    noise = variance[members]
    nugget = 1e-3 + noise / np.maximum(spread - noise.mean(1), 0.05 * noise.mean(1) + 1e-12)[:, None]
    a = np.zeros((p, k + d + 1, k + d + 1))
    a[:, :k, :k] = -r
    diagonal = np.arange(k)
    a[:, diagonal, diagonal] = nugget
    tail = np.concatenate([np.ones((p, k, 1)), z], 2)
    a[:, :k, k:], a[:, k:, :k] = tail, tail.transpose(0, 2, 1)
    # a ridge on the linear part: neighbours that lie in a plane leave one slope open
    slope = np.arange(k + 1, k + d + 1)
    a[:, slope, slope] = -1e-4
    rhs = np.concatenate([ys, np.zeros((p, d + 1, y.shape[1]))], 1)
    return a, rhs


def _self_first(members, i):
    """The sample itself in column 0 (duplicates may have pushed it elsewhere or out)."""
    members = members.copy()
    where = members == i[:, None]
    found = where.any(1)
    column = np.where(found, where.argmax(1), members.shape[1] - 1)
    rows = np.arange(len(i))
    members[rows, column] = members[:, 0]
    members[:, 0] = i
    return members


def _bisection_order(x: Array) -> np.ndarray:
    """Indices along a k-d tree's leaves: neighbours in space are neighbours in the list."""
    return cKDTree(x, leafsize=8).indices


def _chunks(n: int, size: int):
    return [slice(s, min(s + size, n)) for s in range(0, n, size)]
