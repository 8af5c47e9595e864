"""A sampler for isotropic BRDFs that come as values alone: half vectors by a histogram of theta_h, plus a cosine."""

import numpy as np

from gonio.geometry import Array, cos_theta_d, half_vector, reflect, to_angles


class HalfSampler:
    """Density of h constant in solid angle within each bin of theta_h, mixed with cosine-weighted directions.

    edges (K+1,) ascending in radians, mass (K,) >= 0 of the bins; diffuse = share of the draws that follow the cosine.
    """

    def __init__(self, edges: Array, mass: Array, diffuse: float = 0.3):
        self.edges, self.diffuse = np.asarray(edges, float), diffuse
        mass = np.asarray(mass, float)
        self.mass = mass / mass.sum() if mass.sum() > 0 else np.full(len(mass), 1 / len(mass))
        # 1 - cos, exact for the narrow bins at the pole
        self._versine = 2 * np.sin(self.edges / 2) ** 2
        self._cumulative = np.concatenate([[0], np.cumsum(self.mass)])
        self._cumulative[-1] = 1
        self._density = self.mass / (2 * np.pi * np.diff(self._versine))

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        from gonio.brdf.models.lambert import cosine_hemisphere

        cosine = u[:, 0] < self.diffuse
        v = np.where(cosine, u[:, 0] / self.diffuse, (u[:, 0] - self.diffuse) / (1 - self.diffuse))
        k = np.clip(np.searchsorted(self._cumulative, v, "right") - 1, 0, len(self.mass) - 1)
        t = (v - self._cumulative[k]) / np.where(self.mass[k] > 0, self.mass[k], 1)
        versine = self._versine[k] + np.clip(t, 0, 1) * (self._versine[k + 1] - self._versine[k])
        r, phi = np.sqrt(versine * (2 - versine)), 2 * np.pi * u[:, 1]
        h = np.stack([r * np.cos(phi), r * np.sin(phi), 1 - versine], -1)
        wo = np.where(cosine[:, None], cosine_hemisphere(np.stack([v, u[:, 1]], -1)), reflect(wi, h))
        return wo, self.pdf(wi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        out = np.zeros(len(wi))
        h = half_vector(wi[above], wo[above])
        theta_h, _ = to_angles(h)
        k = np.searchsorted(self.edges, theta_h, "right") - 1
        density = np.where((k >= 0) & (k < len(self.mass)), self._density[np.clip(k, 0, len(self.mass) - 1)], 0)
        lobe = density / (4 * cos_theta_d(wi[above], wo[above]))
        out[above] = self.diffuse * wo[above, 2] / np.pi + (1 - self.diffuse) * lobe
        return out
