"""The ABC model: Löw, Kronander, Ynnerman, Unger 2012, "BRDF models for accurate and efficient rendering of glossy
surfaces", ACM TOG 31(1), its microfacet form:

f = kd/pi + F(theta_d) S(h) G(wi, wo) / (cos(theta_i) cos(theta_o)),  S = a / (1 + b (1 - cos(theta_h)))^c,

with Cook and Torrance's G, and F the Fresnel reflectance of a dielectric of index eta.
"""

import numpy as np

from gonio.brdf.models.fresnel import conductor
from gonio.brdf.models.lambert import cosine_hemisphere, cosine_pdf
from gonio.geometry import Array, cos_theta_d, directions, half_vector, reflect, unit

DIFFUSE_SHARE = 0.3  # of the draws; the rest follow S


class Abc:
    """kd and a are numbers or (C,), b > 0, c > 0 and eta > 1 numbers, common to the channels."""

    kind = "abc"

    def __init__(self, kd, a, b: float, c: float, eta: float = 1.5):
        kd, a = np.broadcast_arrays(np.atleast_1d(np.asarray(kd, float)), np.atleast_1d(np.asarray(a, float)))
        self.kd, self.a = np.array(kd), np.array(a)
        self.b, self.c, self.eta = float(b), float(c), float(eta)

    @property
    def channels(self) -> int:
        return len(self.kd)

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = directions(wi), directions(wo)
        out = np.zeros((len(wi), self.channels))
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        out[above] = self.kd / np.pi + self.a * lobe(wi[above], wo[above], self.b, self.c, self.eta)[:, None]
        return out

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        diffuse = u[:, 0] < DIFFUSE_SHARE
        v = np.where(diffuse, u[:, 0] / DIFFUSE_SHARE, (u[:, 0] - DIFFUSE_SHARE) / (1 - DIFFUSE_SHARE))
        t = _inverse(v, self.b, self.c)  # 1 - cos(theta_h)
        r, phi = np.sqrt(t * (2 - t)), 2 * np.pi * u[:, 1]
        h = unit(np.stack([r * np.cos(phi), r * np.sin(phi), 1 - t], -1))
        wo = np.where(diffuse[:, None], cosine_hemisphere(np.stack([v, u[:, 1]], -1)), reflect(wi, h))
        return wo, self.pdf(wi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        wi, wo = directions(wi), directions(wo)
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        out = np.zeros(len(wi))
        h = half_vector(wi[above], wo[above])
        density = (1 + self.b * one_minus_cos(h)) ** -self.c / (2 * np.pi * _integral(self.b, self.c))
        lobe_pdf = density / (4 * cos_theta_d(wi[above], wo[above]))
        out[above] = DIFFUSE_SHARE * cosine_pdf(wo[above]) + (1 - DIFFUSE_SHARE) * lobe_pdf
        return out

    def to_arrays(self) -> dict[str, Array]:
        return {"kd": self.kd, "a": self.a, "shape": np.array([self.b, self.c, self.eta])}

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "Abc":
        return cls(d["kd"], d["a"], *(float(v) for v in d["shape"]))


def lobe(wi: Array, wo: Array, b: float, c: float, eta: float) -> Array:
    """F S G / (cos(theta_i) cos(theta_o)) at a = 1, (N,); both directions above the horizon."""
    h = half_vector(wi, wo)
    cos_d = cos_theta_d(wi, wo)
    fresnel = conductor(cos_d, np.array([eta]), np.array([0.0]))[:, 0]
    g = np.minimum(1, 2 * h[:, 2] * np.minimum(wi[:, 2], wo[:, 2]) / cos_d)
    return fresnel * g * (1 + b * one_minus_cos(h)) ** -c / (wi[:, 2] * wo[:, 2])


def one_minus_cos(h: Array) -> Array:
    """1 - cos(theta_h) without the cancellation."""
    return (h[:, 0] ** 2 + h[:, 1] ** 2) / (1 + h[:, 2])


def _integral(b: float, c: float) -> float:
    """Integral of (1 + b t)^-c over t in [0, 1]."""
    k = (1 - c) * np.log1p(b)
    return np.log1p(b) / b * (np.expm1(k) / k if abs(k) > 1e-9 else 1.0)


def _inverse(v: Array, b: float, c: float) -> Array:
    """t where that integral has grown to the share v."""
    k = (1 - c) * np.log1p(b)
    if abs(k) < 1e-9:
        return np.expm1(v * np.log1p(b)) / b
    return np.expm1(np.log1p(v * np.expm1(k)) / (1 - c)) / b
