"""Piecewise-bilinear functions and densities on the unit square, one per node of a parameter grid.

A point of the square is (x, y): x runs along the columns (last axis), y along the rows. Between nodes of the
parameters everything is linear; outside the grid the nearest node holds. Dupuy and Jakob 2018, and pbrt's
PiecewiseLinear2D.
"""

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array

Index = NDArray[np.int64]
Corners = list[tuple[Index, Array]]


class ParameterGrid:
    """Axes of the parameters (each ascending, one node at least); slices are numbered in C order."""

    def __init__(self, *axes: Array):
        self.axes = [np.asarray(a, float) for a in axes]
        self.size = int(np.prod([len(a) for a in self.axes], initial=1))

    def corners(self, *p: Array) -> Corners:
        """For parameters p, (N,) each: the slices between which they lie and the weights, summing to 1."""
        out: Corners = [(np.zeros(len(p[0]) if p else 1, np.int64), np.ones(len(p[0]) if p else 1))]
        for axis, v in zip(self.axes, p):
            if len(axis) == 1:
                continue
            k = np.clip(np.searchsorted(axis, v, "right") - 1, 0, len(axis) - 2)
            t = np.clip((v - axis[k]) / (axis[k + 1] - axis[k]), 0, 1)
            low = [(i * len(axis) + k, w * (1 - t)) for i, w in out]
            out = low + [(i * len(axis) + k + 1, w * t) for i, w in out]
        return out


class Interpolant:
    """Functions with C channels on the square: data (S, H, W, C), H and W >= 2."""

    def __init__(self, data: Array):
        data = np.asarray(data, float)
        self.height, self.width, self.channels = data.shape[1:]
        self.flat = np.ascontiguousarray(data.reshape(-1, self.channels))

    def eval(self, x: Array, y: Array, corners: Corners) -> Array:
        """Values (N, C) at (x, y) in [0, 1]^2."""
        i, x = _cell(x, self.width)
        j, y = _cell(y, self.height)
        cell = j * self.width + i
        out = np.zeros((len(x), self.channels))
        size = self.height * self.width
        for k, w in corners:
            base = k * size + cell
            for step, weight in ((0, w * (1 - y) * (1 - x)), (1, w * (1 - y) * x)):
                out += weight[:, None] * self.flat.take(base + step, axis=0)
            for step, weight in ((0, w * y * (1 - x)), (1, w * y * x)):
                out += weight[:, None] * self.flat.take(base + self.width + step, axis=0)
        return out


class Warp:
    """Densities on the square, each slice normalised to integrate to 1: data (S, H, W), >= 0.

    `sample` maps uniform (u, v) to points of that density by the inverse of the marginal (rows) and conditional
    (columns) distributions, `invert` is its exact inverse. A slice without any mass is taken as uniform.
    """

    def __init__(self, data: Array):
        d = np.array(data, float)
        d[d.sum((1, 2)) <= 0] = 1
        self.height, self.width = d.shape[1:]
        # the largest value first, so that sums of numbers up to 1e38 or down to 1e-38 keep their digits
        d /= d.max((1, 2), keepdims=True)
        row = 0.5 * (d[..., 1:] + d[..., :-1]).sum(-1)
        total = 0.5 * (row[:, 1:] + row[:, :-1]).sum(-1)
        d /= total[:, None, None]
        cond = np.zeros_like(d)
        np.cumsum(0.5 * (d[..., 1:] + d[..., :-1]), -1, out=cond[..., 1:])
        row = cond[..., -1]
        marg = np.zeros_like(row)
        np.cumsum(0.5 * (row[:, 1:] + row[:, :-1]), -1, out=marg[:, 1:])
        self._d, self._cond, self._marg = d.ravel(), cond.ravel(), marg.ravel()
        self._row = np.ascontiguousarray(row).ravel()
        self._scale = (self.width - 1) * (self.height - 1)

    def eval(self, x: Array, y: Array, corners: Corners) -> Array:
        """Density (N,) at (x, y)."""
        i, x = _cell(x, self.width)
        j, y = _cell(y, self.height)
        c0, c1 = self._columns(j * self.width + i, y, corners)
        return ((1 - x) * c0 + x * c1) * self._scale

    def invert(self, x: Array, y: Array, corners: Corners) -> tuple[Array, Array, Array]:
        """(u, v, density) of the point (x, y): `sample` of (u, v) gives it back."""
        i, x = _cell(x, self.width)
        j, y = _cell(y, self.height)
        cell = j * self.width + i
        c0, c1 = self._columns(cell, y, corners)
        left = self._lerp(self._cond, self.height * self.width, cell, self.width, y, corners)
        r0 = self._get(self._row, self.height, j, corners)
        r1 = self._get(self._row, self.height, j + 1, corners)
        row = (1 - y) * r0 + y * r1
        u = (x * (c0 + 0.5 * x * (c1 - c0)) + left) / np.where(row > 0, row, 1)
        v = y * (r0 + 0.5 * y * (r1 - r0)) + self._get(self._marg, self.height, j, corners)
        return np.clip(u, 0, 1), np.clip(v, 0, 1), ((1 - x) * c0 + x * c1) * self._scale

    def sample(self, u: Array, v: Array, corners: Corners) -> tuple[Array, Array, Array]:
        """(x, y, density) for uniform (u, v) in [0, 1)^2."""
        h, w = self.height, self.width
        j = _bisect(lambda k: self._get(self._marg, h, k, corners) <= v, h - 1, len(v))
        r0, r1 = self._get(self._row, h, j, corners), self._get(self._row, h, j + 1, corners)
        y = _solve(r0, r1, v - self._get(self._marg, h, j, corners))
        target = u * ((1 - y) * r0 + y * r1)
        first = j * w
        at = lambda k: self._lerp(self._cond, h * w, first + k, w, y, corners)
        i = _bisect(lambda k: at(k) <= target, w - 1, len(v))
        c0, c1 = self._columns(first + i, y, corners)
        x = _solve(c0, c1, target - at(i))
        return (i + x) / (w - 1), (j + y) / (h - 1), ((1 - x) * c0 + x * c1) * self._scale

    def _columns(self, cell: Index, y: Array, corners: Corners) -> tuple[Array, Array]:
        """Values on the left and right edge of the cell at height y."""
        size = self.height * self.width
        c0 = self._lerp(self._d, size, cell, self.width, y, corners)
        return c0, self._lerp(self._d, size, cell + 1, self.width, y, corners)

    def _lerp(self, table: Array, size: int, cell: Index, stride: int, y: Array, corners: Corners) -> Array:
        out = np.zeros(len(y))
        for k, w in corners:
            base = k * size + cell
            a = table.take(base)
            out += w * (a + y * (table.take(base + stride) - a))
        return out

    @staticmethod
    def _get(table: Array, size: int, index: Index, corners: Corners) -> Array:
        return sum((w * table.take(k * size + index) for k, w in corners), np.zeros(len(index)))


def _cell(x: Array, n: int) -> tuple[Index, Array]:
    """Cell number and place within the cell of x in [0, 1] on n nodes."""
    x = x * (n - 1)
    i = np.clip(x.astype(np.int64), 0, n - 2)
    return i, np.clip(x - i, 0, 1)


def _bisect(below, cells: int, n: int) -> Index:
    """Largest k in [0, cells) with below(k), which holds for k = 0 and is monotonous; (n,)."""
    low, high = np.zeros(n, np.int64), np.full(n, cells, np.int64)
    for _ in range(int(np.ceil(np.log2(max(cells, 2))))):
        mid = (low + high) // 2
        yes = below(mid)
        low, high = np.where(yes, mid, low), np.where(yes, high, np.maximum(mid, low + 1))
    return low


def _solve(a: Array, b: Array, area: Array) -> Array:
    """t in [0, 1] where the integral of the line from a to b reaches `area`; free of cancellation."""
    root = np.sqrt(np.maximum(a * a + 2 * area * (b - a), 0))
    return np.clip(2 * area / np.where(a + root > 0, a + root, 1), 0, 1)
