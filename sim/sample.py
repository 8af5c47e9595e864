"""The piece of material on a simulated rig, as seen through apertures of finite size."""

import numpy as np

from gonio.brdf.base import Brdf
from gonio.geometry import Array


class Sample:
    """What a detector of half-angle `seen` sees of `truth` under a light of half-angle `lit` (both rad).

    The mean of f cos(theta_i) over both cones (quadrature), divided by the cosine at the centre: the f that a
    reduction for point apertures would report. With both 0 it is `truth.eval`.
    """

    def __init__(self, truth: Brdf, lit: float = 0.0, seen: float = 0.0):
        self.truth = truth
        self._lit, self._seen = _disk(lit), _disk(seen)

    @property
    def channels(self) -> int:
        return self.truth.channels

    def eval(self, wi: Array, wo: Array) -> Array:
        """f, (N, C) in 1/sr, of directions (N, 3); NaN never, 0 below the horizon."""
        if len(self._lit[1]) == len(self._seen[1]) == 1:
            return self.truth.eval(wi, wo)
        (at_light, weight_light), (at_detector, weight_detector) = self._lit, self._seen
        light = np.stack([_off_axis(wi, a) for a in at_light])[:, None]  # (light points, 1, N, 3)
        seen = np.stack([_off_axis(wo, b) for b in at_detector])[None]  # (1, detector points, N, 3)
        light, seen = np.broadcast_arrays(light, seen)
        f = self.truth.eval(light.reshape(-1, 3), seen.reshape(-1, 3)).reshape(*light.shape[:3], -1)
        cosine = np.maximum(light[..., 2:], 0)
        total = np.einsum("a,b,abnc->nc", weight_light, weight_detector, cosine * f)
        return total / np.maximum(wi[:, 2], 1e-300)[:, None]


def _disk(half_angle: float) -> tuple[Array, Array]:
    """Points (7, 2) in a disk and weights (7,), exact to degree 5 (Abramowitz & Stegun 25.4.61)."""
    if half_angle == 0:
        return np.zeros((1, 2)), np.ones(1)
    angle = np.arange(6) * np.pi / 3
    ring = np.sqrt(2 / 3) * np.stack([np.cos(angle), np.sin(angle)], -1)
    return half_angle * np.concatenate([np.zeros((1, 2)), ring]), np.array([1 / 4] + [1 / 8] * 6)


def _off_axis(w: Array, offset: Array) -> Array:
    """Directions `offset` (2,) rad away from w (N, 3)."""
    if not offset.any():
        return w
    # any frame about w will do: the rule is even
    sign = np.where(w[:, 2] >= 0, 1.0, -1.0)
    a = -1 / (sign + w[:, 2])
    b = w[:, 0] * w[:, 1] * a
    x = np.stack([1 + sign * w[:, 0] ** 2 * a, sign * b, -sign * w[:, 0]], -1)
    y = np.stack([b, sign + w[:, 1] ** 2 * a, -w[:, 1]], -1)
    angle = np.hypot(*offset)
    return np.cos(angle) * w + np.sin(angle) / angle * (offset[0] * x + offset[1] * y)
