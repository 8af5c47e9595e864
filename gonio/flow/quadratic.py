"""Piecewise-quadratic warp of [0, 1] (Müller et al., Neural Importance Sampling, 2019): its density is a polygon.

K bins of widths w_k and K + 1 vertex heights v_k, the area under which is 1. z(x) is the area left of x, so that
dz/dx = v at x. All in float64 whatever the network is: in float32 the ratio of two densities is worth nothing.
"""

from typing import Any

import numpy as np

from gonio.geometry import Array

SMALLEST = 1e-3  # of a bin's width and a vertex's height: what bounds the slope of the inverse


class Quadratic:
    """One warp for each of N points, from `raw` (N, 2K + 1), any real numbers; `tied`: the density closes at 1 ~ 0."""

    @staticmethod
    def parameters(bins: int) -> int:
        return 2 * bins + 1

    def __init__(self, raw: Array, bins: int, tied: bool):
        e = np.exp(raw - raw.max(1, keepdims=True))
        w = e[:, :bins].astype(float)
        v = e[:, bins:].astype(float)
        if tied:
            v[:, -1] = v[:, 0]
        w *= (1 - bins * SMALLEST) / np.add.reduce(w, 1)[:, None]
        w += SMALLEST
        area = v[:, 1:] + v[:, :-1]
        area *= w
        v *= (1 - SMALLEST) / (0.5 * np.add.reduce(area, 1))[:, None]
        v += SMALLEST
        self.w, self.v = w, v
        self.x = np.cumsum(w, 1)
        area = v[:, 1:] + v[:, :-1]
        area *= w
        area *= 0.5
        self.z = np.cumsum(area, 1)
        self.last = bins - 1

    def forward(self, x: Array) -> tuple[Array, Array]:
        """z and log dz/dx at x (N,) in [0, 1]."""
        at, k, left_x, left_z = self._bin(x, self.x)
        w, v0, v1 = self.w[at, k], self.v[at, k], self.v[at, k + 1]
        t = np.minimum((x - left_x) / w, 1.0)
        t = np.maximum(t, 0.0)
        rise = v1 - v0
        z = left_z + t * w * (v0 + 0.5 * t * rise)
        return np.minimum(z, 1.0), np.log(v0 + t * rise)

    def inverse(self, z: Array) -> tuple[Array, Array]:
        """x and log dz/dx there, for z (N,) in [0, 1]."""
        at, k, left_x, left_z = self._bin(z, self.z)
        w, v0, v1 = self.w[at, k], self.v[at, k], self.v[at, k + 1]
        # the form of the root that does not cancel
        rise, r = v1 - v0, np.maximum(z - left_z, 0.0) / w
        t = np.minimum(2 * r / (v0 + np.sqrt(np.maximum(v0 * v0 + 2 * rise * r, 0.0))), 1.0)
        return np.minimum(left_x + t * w, 1.0), np.log(v0 + t * rise)

    def _bin(self, y: Array, edges: Array) -> tuple[Any, Array, Array, Array]:
        """Row and bin of each y, and where the bin begins in x and in z."""
        at = np.arange(len(y)) if len(self.w) > 1 else 0
        k = np.add.reduce(edges[:, : self.last] <= y[:, None], 1)
        before, inner = k - 1, k > 0
        return at, k, self.x[at, before] * inner, self.z[at, before] * inner
