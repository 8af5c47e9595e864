"""The BRDF of a surface that is given as heights: a sum over its facets, each seen or hidden, lit or in shadow.

    f(wi, wo) = 1 / (P cos_i cos_o) sum_k f_k(wi, wo) (wi.n_k)+ (wo.n_k)+ V_k(wi) V_k(wo) / (n_k.z)

over P points even over the plane, with normals n_k; 1 / (n_k.z) is the facet's area above that of the plane
(Ashikhmin, Premoze & Shirley 2000, eq. 6, with the true visibility in place of a model). V by horizons that were
marched once. Light that meets the surface a second time is not followed. The sum is asked at the directions themselves,
not at the nodes of a table; its error is that of P points, and `std` says how large it is.
"""

import numpy as np

from gonio.brdf.models.half_sampler import HalfSampler
from gonio.brdf.surfaces.horizons import AZIMUTHS, horizons
from gonio.brdf.surfaces.shapes import Shape, normals
from gonio.geometry import Array, directions, half_vector

POINTS = 4096
GROUPS = 8  # of points, for the error
CHUNK = 128


class MicroSurface:
    """f of a `Shape`, C = 3, cosine not included; reciprocal; not isotropic."""

    channels = 3

    def __init__(self, shape: Shape, points: int = POINTS, seed: int = 0):
        at = _even_points(len(shape.height), points, np.random.default_rng(seed))
        pick = at[:, 0], at[:, 1]
        self.alpha = shape.alpha
        self._n = normals(shape.height)[pick]
        self._diffuse, self._f0 = shape.diffuse[pick] / np.pi, shape.f0[pick]
        seen = horizons(shape.height, at)
        self._horizon = np.concatenate([seen, seen[:, :1]], 1)
        edges = np.pi / 2 * np.linspace(0, 1, 65) ** 2
        self._sampler = HalfSampler(
            edges, self._normals_by_theta(0.5 * (edges[1:] + edges[:-1])) * np.diff(-np.cos(edges))
        )

    def eval(self, wi: Array, wo: Array) -> Array:
        return self._by_group(wi, wo).mean(0)

    def std(self, wi: Array, wo: Array) -> Array:
        """Standard error of `eval` for the points that were taken, (N, 3)."""
        return self._by_group(wi, wo).std(0, ddof=1) / np.sqrt(GROUPS)

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        return self._sampler.sample(wi, u)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self._sampler.pdf(wi, wo)

    def _by_group(self, wi: Array, wo: Array) -> Array:
        """f of each group of points alone, (GROUPS, N, 3)."""
        wi, wo = directions(wi), directions(wo)
        out = np.zeros((GROUPS, len(wi), 3))
        up = np.flatnonzero((wi[:, 2] > 0) & (wo[:, 2] > 0))
        for start in range(0, len(up), CHUNK):
            part = up[start : start + CHUNK]
            out[:, part] = self._sums(wi[part], wo[part])
        return out

    def _sums(self, wi: Array, wo: Array) -> Array:
        h = half_vector(wi, wo)
        ci, co, ch = (np.maximum(w @ self._n.T, 0) for w in (wi, wo, h))
        seen = self._visible(wi) & self._visible(wo) & (ci > 0) & (co > 0)
        weight = seen / (self._n[:, 2] * (wi[:, 2] * wo[:, 2])[:, None])
        a2 = self.alpha**2
        # GGX and its shadowing between facets smaller than the grid (Walter et al. 2007)
        d = a2 / (np.pi * (1 - ch * ch * (1 - a2)) ** 2)
        g = 2 / (1 + np.sqrt(1 + a2 * (1 / np.maximum(ci, 1e-9) ** 2 - 1)))
        g *= 2 / (1 + np.sqrt(1 + a2 * (1 / np.maximum(co, 1e-9) ** 2 - 1)))
        lobe = 0.25 * weight * d * g
        schlick = ((1 - np.einsum("ni,ni->n", wi, h)) ** 5)[:, None]
        size = -(-len(self._n) // GROUPS)
        groups = []
        for start in range(0, len(self._n), size):
            of = slice(start, start + size)
            fresnel = lobe[:, of] @ self._f0[of] * (1 - schlick) + lobe[:, of].sum(1, keepdims=True) * schlick
            groups.append((fresnel + (weight * ci * co)[:, of] @ self._diffuse[of]) / len(self._n[of]))
        return np.array(groups)

    def _visible(self, w: Array) -> Array:
        """(N, P): above the horizon of its azimuth, between two that were marched the mean of both."""
        azimuth = np.arctan2(w[:, 1], w[:, 0]) % (2 * np.pi) * (AZIMUTHS / (2 * np.pi))
        low = np.minimum(azimuth.astype(int), AZIMUTHS - 1)
        part = (azimuth - low)[:, None]
        horizon = (1 - part) * self._horizon.T[low] + part * self._horizon.T[low + 1]
        return w[:, 2:] > horizon * np.hypot(w[:, :1], w[:, 1:2])

    def _normals_by_theta(self, theta: Array) -> Array:
        """Density of half vectors at theta_h, mean over their azimuth, (K,)."""
        phi = 2 * np.pi * np.arange(32) / 32
        s, c = np.sin(theta)[:, None], np.cos(theta)[:, None] + 0 * phi
        h = np.stack([s * np.cos(phi), s * np.sin(phi), c], -1)
        ch = np.maximum(h @ self._n.T, 0)
        a2 = max(self.alpha, 0.1) ** 2
        return (a2 / (np.pi * (1 - ch * ch * (1 - a2)) ** 2)).mean((1, 2))


def _even_points(n: int, count: int, rng: np.random.Generator) -> Array:
    """Grid points (count, 2), one in each square of a coarser grid, in an order that makes every part even too."""
    side = round(count**0.5)
    if side * side != count or n % side:
        raise ValueError(f"{count} points are not a square that divides {n} cells evenly")
    step = n // side
    corner = np.stack(np.meshgrid(np.arange(side), np.arange(side), indexing="ij"), -1).reshape(-1, 2) * step
    return (corner + rng.integers(0, step, corner.shape))[rng.permutation(count)]
