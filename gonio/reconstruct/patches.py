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

BLEND = 4


class Patches:
    """y(x) for x (M, d): built from X (N, d), y (N, C) and the noise variance of y, (N,)."""

    def __init__(self, x: Array, y: Array, variance: Array, neighbours: int = 50, per_centre: float = 6.0):
        n, d = x.shape
        k = min(neighbours, n)
        centres = min(n, max(8, int(np.ceil(n / per_centre))))
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

    def __call__(self, q: Array) -> Array:
        out = np.empty((len(q), self.coefficients.shape[2]))
        blend = min(BLEND, len(self.centres) - 1)
        for part in _chunks(len(q), 20000):
            distance, patch = self._tree.query(q[part], blend + 1)
            weight = np.maximum(1 - distance[:, :-1] / np.maximum(distance[:, -1:], 1e-12), 1e-9) ** 2
            weight /= weight.sum(1, keepdims=True)
            total = 0.0
            for j in range(blend):
                total = total + weight[:, j, None] * self._one(q[part], patch[:, j])
            out[part] = total
        return out

    def _one(self, q: Array, patch: Array) -> Array:
        """The spline of patch[i] at q[i]; queries sorted by patch would not be faster, memory is."""
        out = np.empty((len(q), self.coefficients.shape[2]))
        order = np.argsort(patch, kind="stable")
        k = self._members.shape[1]
        for part in _chunks(len(q), 4000):
            i = order[part]
            p = patch[i]
            local = self._x[self._members[p]]
            r = np.sqrt(np.maximum(((local - q[i][:, None]) ** 2).sum(-1), 0)) / self.scale[p][:, None]
            c = self.coefficients[p]
            z = (q[i] - self.centres[p]) / self.scale[p][:, None]
            out[i] = np.einsum("nk,nkc->nc", -r, c[:, :k]) + c[:, k] + np.einsum("nd,ndc->nc", z, c[:, k + 1 :])
        return out


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
        inverse = np.linalg.inv(a)[:, 0]
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
