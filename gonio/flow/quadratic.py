"""Piecewise-quadratic warp of [0, 1] (Müller et al., Neural Importance Sampling, 2019): its density is a polygon.

K bins of widths w_k and K + 1 vertex heights v_k, the area under which is 1. z(x) is the area left of x, so that
dz/dx = v at x. All in float64 whatever the network is: in float32 the ratio of two densities is worth nothing.
"""

from functools import lru_cache
from typing import Any

import numpy as np

from gonio.geometry import Array

SMALLEST = 1e-3  # of a bin's width and a vertex's height: what bounds the slope of the inverse


class Quadratic:
    """One warp for each of N points, from `raw` (2K + 1, N), any real numbers; `tied`: the density closes at 1 ~ 0.

    Bins lie along the first axis, so that NumPy adds up rows of N points instead of N rows of bins.
    """

    @staticmethod
    def parameters(bins: int) -> int:
        return 2 * bins + 1

    def __init__(self, raw: Array, bins: int, tied: bool):
        e = raw - raw.max(0)
        np.exp(e, out=e)
        w = e[:bins].astype(float)
        v = e[bins:].astype(float)
        if tied:
            v[-1] = v[0]
        w *= (1 - bins * SMALLEST) / np.add.reduce(w, 0)
        w += SMALLEST
        area = v[1:] + v[:-1]
        area *= w
        v *= (1 - SMALLEST) / (0.5 * np.add.reduce(area, 0))
        v += SMALLEST
        np.add(v[1:], v[:-1], out=area)
        area *= w
        area *= 0.5
        self.w, self.v, self.tied = w, v, tied
        self.x, self.z = edges(w), edges(area)

    def forward(self, x: Array) -> tuple[Array, Array]:
        """z and log dz/dx at x (N,) in [0, 1]."""
        k, at, left_x, left_z = self._bin(x, self.x)
        w, v0, v1 = self.w[k, at], self.v[k, at], self.v[k + 1, at]
        t = np.minimum((x - left_x) / w, 1.0)
        t = np.maximum(t, 0.0)
        rise = v1 - v0
        z = left_z + t * w * (v0 + 0.5 * t * rise)
        return np.minimum(z, 1.0), np.log(v0 + t * rise)

    def inverse(self, z: Array) -> tuple[Array, Array]:
        """x and log dz/dx there, for z (N,) in [0, 1]."""
        k, at, left_x, left_z = self._bin(z, self.z)
        w, v0, v1 = self.w[k, at], self.v[k, at], self.v[k + 1, at]
        # the form of the root that does not cancel
        rise, r = v1 - v0, np.maximum(z - left_z, 0.0) / w
        t = np.minimum(2 * r / (v0 + np.sqrt(np.maximum(v0 * v0 + 2 * rise * r, 0.0))), 1.0)
        return np.minimum(left_x + t * w, 1.0), np.log(v0 + t * rise)

    def gradient(self, x: Array, by_z: Array, by_log: Array) -> tuple[Array, Array]:
        """d/dx (N,) and d/draw (2K + 1, N) of any loss whose derivatives by `forward`'s z and log dz/dx are these."""
        k, at, left_x, _ = self._bin(x, self.x)
        w, v0, v1 = self.w[k, at], self.v[k, at], self.v[k + 1, at]
        t = np.clip((x - left_x) / w, 0.0, 1.0)
        rise = v1 - v0
        slope = v0 + t * rise
        by_t = by_z * w * slope + by_log * rise / slope
        # bins left of x count with their areas, the one x lies in with the part left of it
        left = np.arange(len(self.w))[:, None] < k
        half = left * self.w
        half *= 0.5 * by_z
        by_v = np.zeros_like(self.v)
        by_v[:-1] = half
        by_v[1:] += half
        by_v[k, at] += by_z * w * t * (1 - 0.5 * t) + by_log * (1 - t) / slope
        by_v[k + 1, at] += by_z * w * 0.5 * t * t + by_log * t / slope
        by_w = self.v[1:] + self.v[:-1]
        by_w *= 0.5 * by_z
        by_w -= by_t / w
        by_w *= left
        by_w[k, at] += by_z * t * (v0 + 0.5 * t * rise) - by_t * t / w
        # through the unit area to exp(raw), through the unit sum to the softmax
        u = self.v - SMALLEST
        by_raw_v = by_v * u
        u *= np.add.reduce(by_raw_v, 0) * (0.5 / (1 - SMALLEST))
        by_w -= u[1:]
        by_w -= u[:-1]
        span = np.zeros_like(self.v)
        span[:-1] = self.w
        span[1:] += self.w
        u *= span
        by_raw_v -= u
        if self.tied:
            by_raw_v[0] += by_raw_v[-1]
            by_raw_v[-1] = 0
        p = self.w - SMALLEST
        by_w -= np.add.reduce(p * by_w, 0) / (1 - len(p) * SMALLEST)
        by_w *= p
        return by_t / w, np.concatenate([by_w, by_raw_v])

    def _bin(self, y: Array, inner: Array) -> tuple[Array, Any, Array, Array]:
        """Bin and column of each y, and where the bin begins in x and in z."""
        k = bin_of(y, inner)
        at = np.arange(len(y)) if self.w.shape[1] > 1 else 0
        return k, at, self.x[k, at], self.z[k, at]


def edges(shares: Array) -> Array:
    """Where each bin begins, (K, N), from the shares (K, N) of bins: `cumsum` as a product, five times faster."""
    return _below(len(shares)) @ shares


@lru_cache
def _below(bins: int) -> Array:
    return np.tri(bins, k=-1)


def bin_of(y: Array, left: Array) -> Array:
    """The bin (N,) in which y (N,) lies, of those that begin at `left` (K, N)."""
    return np.add.reduce(left[1:] <= y, 0)
