"""A white standard as its certificate says: between the angles of the table, the nearest ones by their distance."""

import numpy as np

from gonio.brdf.models.lambert import cosine_hemisphere, cosine_pdf
from gonio.geometry import Array

NEAREST = 4


class Standard:
    """f (N, C) at pairs wi, wo (N, 3); isotropic: what counts are the two angles from the normal, and the one
    between."""

    def __init__(self, wi: Array, wo: Array, f: Array, channels: int):
        self.at, self.f = _place(wi, wo), np.broadcast_to(f, (len(f), channels))
        self.channels = channels

    def eval(self, wi: Array, wo: Array) -> Array:
        gap = np.linalg.norm(_place(wi, wo)[:, None] - self.at, axis=-1)
        k = np.argsort(gap, 1)[:, :NEAREST]
        near = np.take_along_axis(gap, k, 1)
        weight = 1 / np.maximum(near, 1e-6) ** 2
        f = (weight[..., None] * self.f[k]).sum(1) / weight.sum(1)[:, None]
        return np.asarray(np.where(((wi[:, 2] > 0) & (wo[:, 2] > 0))[:, None], f, 0.0))

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        wo = cosine_hemisphere(u)
        return wo, self.pdf(wi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return np.where(wi[:, 2] > 0, cosine_pdf(wo), 0)


def _place(wi: Array, wo: Array) -> Array:
    """(N, 3): cosines of the two angles, and of the one between, the same after a swap or a turn."""
    both = np.sort(np.stack([wi[:, 2], wo[:, 2]], -1), -1)
    return np.concatenate([both, 0.5 * (wi * wo).sum(-1, keepdims=True)], -1)
