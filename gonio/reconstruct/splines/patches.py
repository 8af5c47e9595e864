"""Scattered data predicted by many small Gaussian processes that overlap: local kriging, blended.

y is taken for a stationary process of mean 0 (the base) and covariance A exp(-(d / L)^1.5), d the distance in the
stretched coordinates, L = LENGTH the same for all materials since the coordinates are what is fitted to each, A from
the data around (Rasmussen & Williams 2006, ch. 2 and 4.2; Cressie 1993, ch. 3). Around each of P centres the K nearest
samples make one predictor,

    y(q) = k(q)' c,   c = (R + diag(noise / A) + nugget)^-1 y

A query is the weighted mean of its nearest patches, weights falling to 0 at the first patch left out (partition of
unity, Wendland 2004, 15.4), so that the result is continuous. Far from all data the prediction is the base, and
`relative_variance` says by how much the data around narrow what was known without them, from 1 (not at all) to 0.
"""

import numpy as np
from scipy.spatial import cKDTree

from gonio.geometry import Array

LENGTH, POWER = 2.0, 1.5
NUGGET = 1e-3
BLEND = 3
MOST = 60_000
CHUNK = 2000


class Patches:
    """y(x) for x (M, d): built from X (N, d), y (N, C) and the noise variance of y, (N,)."""

    def __init__(self, x: Array, y: Array, variance: Array, neighbours: int = 50, per_centre: float = 6.0):
        n = len(x)
        k = min(neighbours, n)
        centres = min(n, max(8, int(np.ceil(n / per_centre))), MOST)
        # every so many-th sample in a space-filling order: centres as dense as the data, without clumps
        pick = _bisection_order(x)[(np.arange(centres) * n) // centres]
        self.centres = x[pick]
        self._tree = cKDTree(self.centres)
        _, self._members = cKDTree(x).query(self.centres, k)
        self._members = self._members.reshape(centres, k)
        self._x = x
        self.coefficients = np.empty((centres, k, y.shape[1]), np.float32)
        for part in _chunks(centres):
            members = self._members[part]
            self.coefficients[part] = np.linalg.solve(_system(x, y, variance, members), y[members])

    def __call__(self, q: Array) -> Array:
        """(M, C). Patch by patch, each for all queries that it has a say in: few large products, not many small."""
        q = np.asarray(q, float)
        blend = min(BLEND, len(self.centres) - 1)
        distance, patch = self._tree.query(q, blend + 1)
        weight = np.maximum(1 - distance[:, :-1] / np.maximum(distance[:, -1:], 1e-12), 1e-9) ** 2
        weight = (weight / weight.sum(1, keepdims=True)).ravel()
        order = np.argsort(patch[:, :-1].ravel(), kind="stable")
        used, start = np.unique(patch[:, :-1].ravel()[order], return_index=True)
        said = np.empty((len(order), self.coefficients.shape[2]))
        for p, mine in zip(used, np.split(order, start[1:])):
            # float32 is enough once the centre is out: 1e-6 of a patch's own variation
            z = (q[mine // blend] - self.centres[p]).astype(np.float32)
            x = (self._x[self._members[p]] - self.centres[p]).astype(np.float32)
            square = (-2 * z) @ x.T
            square += np.einsum("nd,nd->n", z, z)[:, None]
            square += np.einsum("nd,nd->n", x, x)
            said[mine] = correlation(np.maximum(square, 0, out=square)) @ self.coefficients[p]
        return (said * weight[:, None]).reshape(len(q), blend, -1).sum(1)


def correlation(square: Array) -> Array:
    """exp(-(d / LENGTH)^POWER) of squared distances, written over them: d^1.5 by two square roots."""
    square *= np.asarray(1 / LENGTH**2, square.dtype)
    root = np.sqrt(np.sqrt(square))
    root *= root * root
    return np.exp(np.negative(root, out=root), out=root)


def left_out(x: Array, y: Array, variance: Array, at: Array, neighbours: int = 40) -> Array:
    """What the local predictor says at samples `at` (indices) without them, (len(at), C)."""
    return left_out_with_variance(x, y, variance, at, neighbours)[0]


def left_out_with_variance(
    x: Array, y: Array, variance: Array, at: Array, neighbours: int = 40, without: int = 0
) -> tuple[Array, Array]:
    """The same, and its relative variance (len(at),), the sample's own noise not in it: both from one inverse, by the
    formulas of leave-one-out (Rasmussen & Williams 2006, 5.4.2). without: so many of the nearest are left out besides.
    """
    k = min(neighbours + without, len(x))
    without = min(without, k - 2)
    out, relative = np.empty((len(at), y.shape[1])), np.empty(len(at))
    tree = cKDTree(x)
    for part in _chunks(len(at)):
        i = at[part]
        _, members = tree.query(x[i], k)
        members = _self_first(members.reshape(len(i), k), i)
        members = np.delete(members, np.arange(1, 1 + without), axis=1)
        a = _system(x, y, variance, members)
        own = a[:, 0, 0] - 1  # nugget and noise over A
        unit = np.zeros((*a.shape[:2], 1))
        unit[:, 0] = 1
        inverse = np.linalg.solve(a, unit)[..., 0]  # a is symmetric: its inverse's first row
        out[part] = y[i] - np.einsum("nk,nkc->nc", inverse, y[members]) / inverse[:, :1]
        relative[part] = np.clip(1 / inverse[:, 0] - own, NUGGET, 1)
    return out, relative


def relative_variance(x: Array, y: Array, variance: Array, q: Array, neighbours: int = 30) -> Array:
    """Of the prediction at q (M, d) from samples x, over what is known without them, (M,): NUGGET to 1."""
    k = min(neighbours, len(x))
    tree, out = cKDTree(x), np.empty(len(q))
    for part in _chunks(len(q)):
        distance, members = tree.query(q[part], k)
        members = members.reshape(-1, k)
        towards = correlation(distance.reshape(-1, k) ** 2)
        solved = np.linalg.solve(_system(x, y, variance, members), towards[..., None])[..., 0]
        out[part] = 1 - np.einsum("nk,nk->n", towards, solved)
    return np.clip(out, NUGGET, 1)


def amplitude(y: Array, variance: Array) -> Array:
    """A of the samples of one or many neighbourhoods, y (..., K, C), variance (..., K): their mean square without the
    noise in it; never so small that noise would be followed."""
    noise = variance.mean(-1)
    return np.maximum((y**2).mean((-1, -2)) - noise, 0.05 * noise + 1e-12)


def _system(x: Array, y: Array, variance: Array, members) -> Array:
    z = x[members] - x[members[:, :1]]
    square = (z**2).sum(-1)
    a = correlation(np.maximum(square[:, :, None] + square[:, None] - 2 * z @ z.transpose(0, 2, 1), 0))
    diagonal = np.arange(members.shape[1])
    a[:, diagonal, diagonal] = 1 + NUGGET + variance[members] / amplitude(y[members], variance[members])[:, None]
    return a


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


def _chunks(n: int):
    return [slice(s, min(s + CHUNK, n)) for s in range(0, n, CHUNK)]
