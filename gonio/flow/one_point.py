"""The density at a single point: what one chain asks at every local move.

The same formulas as `gonio.flow.quadratic`, in Python floats: for 32 bins a hundred calls of NumPy cost more than the
arithmetic.
"""

from bisect import bisect_right
from itertools import accumulate
from math import log

import numpy as np

from gonio.flow import encoding
from gonio.flow.coupling import Coupling
from gonio.flow.quadratic import SMALLEST
from gonio.geometry import Array


def log_prob(couplings: list[Coupling], shape, x: Array) -> float:
    """log density at x (D,) of a flow of piecewise-quadratic warps without periodic coordinates."""
    y = [min(max(float(v), 0.0), 1.0) for v in x]
    total = 0.0
    for c in couplings:
        if c.constant is not None:
            z, slope = c.constant[0].forward(np.array([y[c.moved]]))
            y[c.moved], rise = float(z[0]), float(slope[0])
        else:
            raw = c.network(_features(shape.encoding, [y[k] for k in c.given], c.periodic))
            y[c.moved], rise = _warp(y[c.moved], raw, shape.bins)
        total += rise
    return total


def _features(kind: str, given: list[float], periodic: tuple[bool, ...]) -> Array:
    if kind == "plain":
        return np.array([*(2 * g - 1 for g in given), 1.0], np.float32)
    return encoding.features(kind, np.array([given]), periodic)[0]


def _warp(x: float, raw: Array, bins: int) -> tuple[float, float]:
    e = np.exp(raw - raw.max()).tolist()
    scale = (1 - bins * SMALLEST) / sum(e[:bins])
    w = [SMALLEST + scale * v for v in e[:bins]]
    v = e[bins:]
    areas = [a * (b + c) for a, b, c in zip(w, v, v[1:])]
    scale = (1 - SMALLEST) / (0.5 * sum(areas))
    edges = list(accumulate(w))
    k = min(bisect_right(edges, x), bins - 1)
    left = edges[k - 1] if k else 0.0
    v0, v1 = SMALLEST + scale * v[k], SMALLEST + scale * v[k + 1]
    t = min(max((x - left) / w[k], 0.0), 1.0)
    slope = v0 + t * (v1 - v0)
    z = 0.5 * scale * sum(areas[:k]) + SMALLEST * left + 0.5 * t * w[k] * (v0 + slope)
    return min(z, 1.0), log(slope)
