"""Distributions of microfacet normals: D, Smith's Lambda, and a sampler of half vectors. GGX and Beckmann.

Half vectors h and directions w are (N, 3) in the sample's frame; alpha_x, alpha_y > 0 are the roughnesses along the
sample's axes. D is in 1/sr with the integral of D cos(theta_h) equal to 1. Heitz 2014, JCGT 3(2).
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from gonio.geometry import Array, unit


class Normals(Protocol):
    """What a microfacet lobe is made of."""

    @property
    def alpha_x(self) -> float: ...
    @property
    def alpha_y(self) -> float: ...

    def d(self, h: Array) -> Array: ...
    def smith_lambda(self, w: Array) -> Array: ...
    def sample(self, wi: Array, u: Array) -> Array: ...
    def pdf(self, wi: Array, h: Array) -> Array: ...


@dataclass(frozen=True)
class GgxNdf:
    """Trowbridge and Reitz 1975 (GGX); sampled by the visible normals."""

    alpha_x: float
    alpha_y: float

    def d(self, h: Array) -> Array:
        # not the textbook form: cos^2 (a^2 - 1) + 1 loses all digits for small alpha
        x, y, z = h[:, 0] / self.alpha_x, h[:, 1] / self.alpha_y, h[:, 2]
        value = 1 / (np.pi * self.alpha_x * self.alpha_y * (x * x + y * y + z * z) ** 2)
        return np.where(z > 0, value, 0)

    def smith_lambda(self, w: Array) -> Array:
        with np.errstate(divide="ignore"):
            t = ((self.alpha_x * w[:, 0]) ** 2 + (self.alpha_y * w[:, 1]) ** 2) / w[:, 2] ** 2
        return 0.5 * t / (1 + np.sqrt(1 + t))  # (sqrt(1 + t) - 1) / 2 without the cancellation

    def sample(self, wi: Array, u: Array) -> Array:
        """Half vectors by the visible normals of wi: spherical caps, Dupuy and Benyoub 2023.

        The caps' 1 - z and 1 + z are formed from their factors, so that h keeps its digits at alpha = 1e-4.
        """
        s = unit(wi * np.array([self.alpha_x, self.alpha_y, 1.0]))
        up = 1 + s[:, 2]
        down = (s[:, 0] ** 2 + s[:, 1] ** 2) / up  # 1 - s_z
        one_minus = up * u[:, 0]
        one_plus = up * (1 - u[:, 0]) + down
        r, phi = np.sqrt(one_minus * one_plus), 2 * np.pi * u[:, 1]
        h = np.stack([r * np.cos(phi) + s[:, 0], r * np.sin(phi) + s[:, 1], up * (1 - u[:, 0])], -1)
        return unit(h * np.array([self.alpha_x, self.alpha_y, 1.0]))

    def pdf(self, wi: Array, h: Array) -> Array:
        """Density of `sample` in solid angle of h: G1(wi) max(0, wi.h) D(h) / cos(theta_i)."""
        cos_ih = np.maximum(np.einsum("ni,ni->n", wi, h), 0)
        return cos_ih * self.d(h) / ((1 + self.smith_lambda(wi)) * wi[:, 2])


@dataclass(frozen=True)
class BeckmannNdf:
    """Beckmann and Spizzichino 1963: Gaussian slopes; sampled by D cos(theta_h)."""

    alpha_x: float
    alpha_y: float

    def d(self, h: Array) -> Array:
        z2 = np.maximum(h[:, 2], 1e-100) ** 2
        e = ((h[:, 0] / self.alpha_x) ** 2 + (h[:, 1] / self.alpha_y) ** 2) / z2
        value = np.exp(-e - 2 * np.log(z2)) / (np.pi * self.alpha_x * self.alpha_y)
        return np.where(h[:, 2] > 0, value, 0)

    def smith_lambda(self, w: Array) -> Array:
        from scipy.special import erfc

        s = np.hypot(self.alpha_x * w[:, 0], self.alpha_y * w[:, 1])
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            a = w[:, 2] / s
            value = 0.5 * (np.exp(-a * a) / (a * np.sqrt(np.pi)) - erfc(a))
        return np.where(a < 30, np.maximum(value, 0), 0)

    def sample(self, wi: Array, u: Array) -> Array:
        """Half vectors by the slopes' own distribution, the same for every wi."""
        r, phi = np.sqrt(-np.log1p(-u[:, 0])), 2 * np.pi * u[:, 1]
        slope = np.stack([self.alpha_x * r * np.cos(phi), self.alpha_y * r * np.sin(phi), np.ones(len(u))], -1)
        return unit(slope)

    def pdf(self, wi: Array, h: Array) -> Array:
        """Density of `sample` in solid angle of h: D(h) cos(theta_h)."""
        return self.d(h) * h[:, 2]
