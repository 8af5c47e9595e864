"""The ideal diffuser, and the cosine density that every diffuse part is sampled by."""

import numpy as np

from gonio.geometry import Array


class Lambert:
    """f = albedo / pi. albedo is a number or (C,), each within 0..1 for a surface that makes no light."""

    kind = "lambert"

    def __init__(self, albedo):
        self.albedo = np.atleast_1d(np.asarray(albedo, float))

    @property
    def channels(self) -> int:
        return len(self.albedo)

    def eval(self, wi: Array, wo: Array) -> Array:
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        return above[:, None] * (self.albedo / np.pi)

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        wo = cosine_hemisphere(u)
        return wo, self.pdf(wi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return np.where(wi[:, 2] > 0, cosine_pdf(wo), 0)

    def to_arrays(self) -> dict[str, Array]:
        return {"albedo": self.albedo}

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "Lambert":
        return cls(d["albedo"])


def cosine_hemisphere(u: Array) -> Array:
    """Directions (N, 3) with density cos(theta)/pi for uniform u (N, 2)."""
    r, phi = np.sqrt(u[:, 0]), 2 * np.pi * u[:, 1]
    return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1 - u[:, 0])], -1)


def cosine_pdf(w: Array) -> Array:
    return np.maximum(w[:, 2], 0) / np.pi
