"""A table over a box, smooth between few nodes and quick to read: cubic splines refine it once, lookups are linear."""

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array

CHUNK = 1 << 16


class Lookup:
    """values (n_1, …, n_d, C) at equal steps over [0, 1]^d; a periodic axis does not repeat its first node at 1.

    Each axis gets `refine` times as many steps by a cubic spline through the nodes; between those, multilinear.
    """

    def __init__(self, values: Array, periodic: tuple[bool, ...], refine: tuple[int, ...]):
        self.values = np.asarray(values, np.float32)
        self.periodic, self.refine = periodic, refine
        fine = self.values
        for axis, (wraps, factor) in enumerate(zip(periodic, refine)):
            fine = _refined(fine, axis, wraps, factor)
        self._steps = np.array([n - 1 for n in fine.shape[:-1]])
        strides = np.cumprod((1, *fine.shape[:0:-1][1:]))[::-1]
        self._strides = strides.astype(np.int64)
        # rows of four floats are gathered as one complex number: three times as fast as a row of three
        self._channels = fine.shape[-1]
        width = -(-self._channels // 4) * 4
        self._flat = np.zeros((fine[..., 0].size, width), np.float32)
        self._flat[:, : self._channels] = fine.reshape(-1, self._channels)
        self._packed = self._flat.view(np.complex128)

    def __call__(self, t: Array) -> Array:
        """(M, C) at t (M, d); clamped at the ends of the box."""
        out = np.empty((len(t), self._channels))
        for start in range(0, len(t), CHUNK):
            out[start : start + CHUNK] = self._linear(t[start : start + CHUNK])[:, : self._channels]
        return out

    def _linear(self, t: Array) -> NDArray[np.float32]:
        x = np.clip(t, 0, 1) * self._steps
        low = np.minimum(x.astype(np.int64), self._steps - 1)
        part = (x - low).astype(np.float32)
        corner = low @ self._strides
        total = np.zeros((len(t), self._flat.shape[1]), np.float32)
        d = len(self._steps)
        corners = [(np.ones(len(t), np.float32), 0)]
        for axis in range(d):
            high = np.ascontiguousarray(part[:, axis])
            rest = 1 - high
            corners = [(w * rest, s) for w, s in corners] + [(w * high, s + self._strides[axis]) for w, s in corners]
        for weight, step in corners:
            total += weight[:, None] * self._gather(corner + step)
        return total

    def _gather(self, rows) -> NDArray[np.float32]:
        if self._packed.shape[1] == 1:
            return self._packed[:, 0].take(rows).view(np.float32).reshape(len(rows), 4)
        return self._flat.take(rows, 0)


def nodes(n: int, wraps: bool) -> Array:
    """Where the n nodes of an axis lie in [0, 1]."""
    return np.arange(n) / n if wraps else np.linspace(0, 1, n)


def _refined(values, axis: int, wraps: bool, factor: int):
    """The cubic spline is linear in its values: one small matrix per axis, applied to all columns at once."""
    from scipy.interpolate import make_interp_spline

    n = values.shape[axis]
    if factor == 1:
        return np.take(values, np.arange(n + 1) % n, axis) if wraps else values
    if wraps:  # three nodes more at either end make the spline as good as periodic
        which = np.arange(-3, n + 4) % n
        at = np.arange(-3, n + 4) / n
    else:
        which, at = np.arange(n), nodes(n, False)
    fine = np.linspace(0, 1, (n if wraps else n - 1) * factor + 1)
    matrix = make_interp_spline(at, np.eye(n)[which], 3)(fine).astype(np.float32)
    return np.moveaxis(np.tensordot(matrix, values, (1, axis)), 0, axis)
