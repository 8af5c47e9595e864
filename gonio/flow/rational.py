"""Monotone rational-quadratic warp of [0, 1] (Gregory & Delbourgo 1982; Durkan et al., Neural Spline Flows, 2019).

K bins of widths w_k, heights h_k and K + 1 slopes d_k > 0 at the knots.
"""

import numpy as np

from gonio.flow.quadratic import SMALLEST, bin_of, edges
from gonio.geometry import Array


class Rational:
    """One warp for each of N points, from `raw` (3K + 1, N), any real numbers; `tied`: the slope closes at 1 ~ 0."""

    @staticmethod
    def parameters(bins: int) -> int:
        return 3 * bins + 1

    def __init__(self, raw: Array, bins: int, tied: bool):
        raw = raw.astype(float)
        self.w = _shares(raw[:bins])
        self.h = _shares(raw[bins : 2 * bins])
        self.d = SMALLEST + np.logaddexp(0.0, raw[2 * bins :])
        if tied:
            self.d[-1] = self.d[0]
        self.x, self.z = edges(self.w), edges(self.h)

    def forward(self, x: Array) -> tuple[Array, Array]:
        """z and log dz/dx at x (N,) in [0, 1]."""
        w, h, d0, d1, left_x, left_z = self._bin(x, self.x)
        t = np.clip((x - left_x) / w, 0.0, 1.0)
        s = h / w
        down = s + (d0 + d1 - 2 * s) * t * (1 - t)
        z = left_z + h * t * (s * t + d0 * (1 - t)) / down
        return np.minimum(z, 1.0), _log_slope(t, s, d0, d1)

    def inverse(self, z: Array) -> tuple[Array, Array]:
        """x and log dz/dx there, for z (N,) in [0, 1]."""
        w, h, d0, d1, left_x, left_z = self._bin(z, self.z)
        s = h / w
        y = np.clip(z - left_z, 0.0, h)
        bend = d0 + d1 - 2 * s
        a, b, c = h * (s - d0) + y * bend, h * d0 - y * bend, -s * y
        t = np.clip(-2 * c / (b + np.sqrt(np.maximum(b * b - 4 * a * c, 0.0))), 0.0, 1.0)
        return np.minimum(left_x + t * w, 1.0), _log_slope(t, s, d0, d1)

    def _bin(self, y: Array, inner: Array) -> tuple[Array, ...]:
        k = bin_of(y, inner)
        at = np.arange(len(y)) if self.w.shape[1] > 1 else 0
        w, h, d0, d1 = self.w[k, at], self.h[k, at], self.d[k, at], self.d[k + 1, at]
        return w, h, d0, d1, self.x[k, at], self.z[k, at]


def _shares(raw: Array) -> Array:
    """Widths of sum 1, none below SMALLEST."""
    e = np.exp(raw - raw.max(0))
    return SMALLEST + (1 - len(raw) * SMALLEST) * e / e.sum(0)


def _log_slope(t: Array, s: Array, d0: Array, d1: Array) -> Array:
    u = 1 - t
    up = s * s * (d1 * t * t + 2 * s * t * u + d0 * u * u)
    return np.log(up) - 2 * np.log(s + (d0 + d1 - 2 * s) * t * u)
