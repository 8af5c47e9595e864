"""Microfacet lobes whose tails are as long as one likes: slopes of Student's t (Ribardière et al. 2017, CGF 36).

    D(h) = (gamma - 1) / (pi alpha_x alpha_y cos^4(theta_h)) (1 + s^2)^-gamma,  s^2 = (x / alpha_x)^2 + (y / alpha_y)^2

of slopes (x, y). gamma = 2 is GGX, smaller has longer tails, larger shorter ones: towards Beckmann's with
alpha / sqrt(gamma). The slope along any direction follows Student's t of nu = 2 gamma - 2 degrees of freedom, so that
Smith's Lambda has a closed form for gamma > 3/2.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from gonio.brdf.models.microfacet import Microfacet
from gonio.geometry import Array, unit


@dataclass(frozen=True)
class StudentNdf:
    """Sampled by D cos(theta_h)."""

    alpha_x: float
    alpha_y: float
    gamma: float

    def d(self, h: Array) -> Array:
        z2 = np.maximum(h[:, 2], 1e-100) ** 2
        s2 = ((h[:, 0] / self.alpha_x) ** 2 + (h[:, 1] / self.alpha_y) ** 2) / z2
        scale = np.log((self.gamma - 1) / (np.pi * self.alpha_x * self.alpha_y))
        return np.where(h[:, 2] > 0, np.exp(scale - 2 * np.log(z2) - self.gamma * np.log1p(s2)), 0)

    def smith_lambda(self, w: Array) -> Array:
        """(E[q | q > mu] - mu) P(q > mu) / mu of the slope q towards w over its alpha; mu = cot(theta) / alpha."""
        from scipy.special import gammaln, stdtr

        nu = 2 * self.gamma - 2
        s = np.maximum(np.hypot(self.alpha_x * w[:, 0], self.alpha_y * w[:, 1]), 1e-300)
        mu = np.maximum(w[:, 2], 1e-300) / s
        constant = np.exp(gammaln((nu + 1) / 2) - gammaln(nu / 2)) / np.sqrt(np.pi)
        tail = constant * np.exp(0.5 * (1 - nu) * np.log1p(np.minimum(mu, 1e150) ** 2)) / (nu - 1)
        return np.maximum(tail / mu - stdtr(nu, -mu * np.sqrt(nu)), 0)

    def sample(self, wi: Array, u: Array) -> Array:
        """Half vectors by the slopes' own distribution, the same for every wi."""
        r, phi = np.sqrt(np.expm1(-np.log1p(-u[:, 0]) / (self.gamma - 1))), 2 * np.pi * u[:, 1]
        slope = np.stack([self.alpha_x * r * np.cos(phi), self.alpha_y * r * np.sin(phi), np.ones(len(u))], -1)
        return unit(slope)

    def pdf(self, wi: Array, h: Array) -> Array:
        """Density of `sample` in solid angle of h: D(h) cos(theta_h)."""
        return self.d(h) * h[:, 2]


class Student(Microfacet):
    """`Microfacet` with Student-t slopes of exponent gamma > 3/2."""

    kind = "student"

    def __init__(self, alpha_x: float, alpha_y: float | None = None, f0=1.0, *, gamma: float = 2.0, weight=1.0):
        if not gamma > 1.5:
            raise ValueError(f"gamma must be above 1.5, not {gamma}")
        self.gamma = float(gamma)
        self.ndf_class = partial(StudentNdf, gamma=self.gamma)
        super().__init__(alpha_x, alpha_y, f0, weight=weight)

    def to_arrays(self) -> dict[str, Array]:
        return super().to_arrays() | {"gamma": np.array(self.gamma)}

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "Student":
        alpha_x, alpha_y = (float(a) for a in d["alpha"])
        return cls(alpha_x, alpha_y, d["f0"], gamma=float(d["gamma"]), weight=d["weight"])
