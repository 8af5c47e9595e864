"""How long a move takes. All axes of a move start and stop together, so a move is a straight line in joint space.

The law is the trapezoid: accelerate at a, cruise at v, brake at a. Along a straight line with distances d the axes
share one profile, limited by the tightest of them; for axes alike that is the slowest axis's own time,
2 sqrt(d/a) where d < v^2/a, else d/v + v/a.
"""

import numpy as np

from gonio.geometry import Array


def move_time(delta: Array, velocity: Array, acceleration: Array) -> Array:
    """Seconds (...,) that joint distances delta (..., A) take; velocity, acceleration (A,) in rad/s, rad/s^2."""
    d = np.abs(delta)
    return _time(_most(d, velocity), _most(d, acceleration))


def _most(d: Array, scale: Array) -> Array:
    """max over axes of d / scale."""
    if d.size < 256:
        return (d / scale).max(-1)
    most = d[..., 0] / scale[0]  # axis by axis: a reduction over a last axis of four is slow
    for k in range(1, len(scale)):
        np.maximum(most, d[..., k] / scale[k], out=most)
    return most


def _time(cruise: Array, ramp: Array) -> Array:
    """cruise = max d/v in s, ramp = max d/a in s^2."""
    return np.where(ramp < cruise * cruise, cruise + ramp / np.maximum(cruise, 1e-300), 2 * np.sqrt(ramp))


def progress(delta: Array, velocity: Array, acceleration: Array, t: float) -> float:
    """Share in [0, 1] of a move of joint distances delta (A,) that is done t seconds after its start."""
    d = np.abs(delta)
    cruise, ramp = float((d / velocity).max()), float((d / acceleration).max())
    if ramp == 0:
        return 1.0
    total = float(_time(np.array(cruise), np.array(ramp)))
    t = min(max(t, 0.0), total)
    late, a = total - t, 1 / ramp
    t_ramp = min(ramp / cruise, total / 2)
    if t < t_ramp:
        return 0.5 * a * t * t
    if late < t_ramp:
        return 1 - 0.5 * a * late * late
    return 0.5 * a * t_ramp**2 + (t - t_ramp) / cruise
