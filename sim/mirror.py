"""A flat mirror in the sample's place, as light and detector of finite size see it: a bright spot with soft edges."""

from collections.abc import Sequence

import numpy as np

from gonio.brdf.models.spherical import log_vmf_between, sample_vmf
from gonio.geometry import Array, reflect, unit


class Mirror:
    """f cos(theta_o) = reflectance x spherical Gaussian about the mirror image of wi.

    normals: (3,) in the sample's frame, one, or one for each facet of a cracked mirror; width_deg: sd of the spot.
    """

    def __init__(
        self,
        normals: Sequence[Sequence[float]] = ((0.0, 0.0, 1.0),),
        channels: int = 3,
        width_deg: float = 0.5,
        reflectance: float = 0.9,
    ):
        self.normals = unit(np.array(normals, float))
        self.channels, self.reflectance = channels, reflectance
        self.kappa = 1 / np.radians(width_deg) ** 2

    @classmethod
    def on_wedge(cls, wedge_deg: float, channels: int = 3) -> "Mirror":
        """Tilted by `wedge_deg` towards the sample's x, as well as somebody can lay it: 0.5 degrees beside."""
        a, beside = np.radians(wedge_deg + 0.3), np.radians(0.4)
        return cls([[np.sin(a), np.sin(beside), np.cos(a)]], channels)

    def eval(self, wi: Array, wo: Array) -> Array:
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        value = self.reflectance * self._density(wi, wo) / np.maximum(wo[:, 2], 1e-9)
        return np.repeat(np.where(above, value, 0.0)[:, None], self.channels, 1)

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        k = np.minimum((u[:, 0] * len(self.normals)).astype(int), len(self.normals) - 1)
        wo = sample_vmf(reflect(wi, self.normals[k]), self.kappa, u[:, 0] * len(self.normals) - k, u[:, 1])
        return wo, np.where(wo[:, 2] > 0, self.pdf(wi, wo), 0.0)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self._density(wi, wo)

    def _density(self, wi: Array, wo: Array) -> Array:
        each = [log_vmf_between(reflect(wi, np.broadcast_to(n, wi.shape)), wo, self.kappa) for n in self.normals]
        return np.asarray(np.exp(each).mean(0))
