"""BRDFs as the thesis hands them to a renderer: per incidence a grid to sample by and a grid of weights.

Both lie over half vectors, columns theta_h = (pi/2) u^2 and rows phi_h = 2 pi v counted from the light's azimuth;
u and v in [0, 1]. f = weight(u, v) pdf(wo | wi) / cos(theta_o), where pdf is that of the visible normals of a GGX lobe;
between two incidences the weights are bilinear (thesis 4.2.1-4.2.3).
"""

import numpy as np

from gonio.brdf.models.ndf import GgxNdf
from gonio.brdf.tables.warp import Corners, Interpolant, ParameterGrid, Warp
from gonio.geometry import Array, directions, from_angles, half_vector, reflect, to_angles


class SlicesBrdf:
    """theta_i (T,) ascending rad; alpha of the lobe; pdf (T, V, U) density on the square; weight (T, V, U, C) >= 0."""

    kind = "slices"

    def __init__(self, theta_i: Array, alpha: float, pdf: Array, weight: Array):
        self.theta_i, self.alpha = np.asarray(theta_i, float), float(alpha)
        self.pdf_grid, self.weight_grid = np.asarray(pdf, float), np.asarray(weight, float)
        self._ndf = GgxNdf(self.alpha, self.alpha)
        self._grid = ParameterGrid(self.theta_i)
        self._warp, self._weight = Warp(self.pdf_grid), Interpolant(self.weight_grid)

    @property
    def channels(self) -> int:
        return self.weight_grid.shape[-1]

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = directions(wi), directions(wo)
        out = np.zeros((len(wi), self.channels))
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        a, b = wi[above], wo[above]
        corners, u, v, h = self._place(a, b)
        pdf = self._ndf.pdf(a, h) / (4 * np.einsum("ni,ni->n", a, h))
        out[above] = self._weight.eval(u, v, corners) * (pdf / b[:, 2])[:, None]
        return out

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        theta_i, phi_i = to_angles(wi)
        x, y, density = self._warp.sample(u[:, 0], u[:, 1], self._grid.corners(theta_i))
        h = from_angles(np.pi / 2 * x * x, 2 * np.pi * y + phi_i)
        wo = reflect(wi, h)
        kept = (wi[:, 2] > 0) & (wo[:, 2] > 0) & (np.einsum("ni,ni->n", wi, h) > 0)
        return wo, np.where(kept, density / _area(x, wi, h), 0)

    def pdf(self, wi: Array, wo: Array) -> Array:
        out = np.zeros(len(wi))
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        a, b = wi[above], wo[above]
        corners, u, v, h = self._place(a, b)
        out[above] = self._warp.eval(u, v, corners) / _area(u, a, h)
        return out

    def to_arrays(self) -> dict[str, Array]:
        arrays = {"theta_i": self.theta_i, "alpha": np.array(self.alpha)}
        return arrays | {"pdf": self.pdf_grid.astype(np.float32), "weight": self.weight_grid.astype(np.float32)}

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "SlicesBrdf":
        return cls(d["theta_i"], float(d["alpha"]), d["pdf"], d["weight"])

    def _place(self, wi: Array, wo: Array) -> tuple[Corners, Array, Array, Array]:
        h = half_vector(wi, wo)
        theta_i, phi_i = to_angles(wi)
        theta_h, phi_h = to_angles(h)
        v = (phi_h - phi_i) / (2 * np.pi)
        return self._grid.corners(theta_i), np.sqrt(theta_h * 2 / np.pi), v - np.floor(v), h


def incidence_grid(alpha: float, n: int) -> Array:
    """n incidences in rad from 0 to 89.5 degrees, at uniform quantiles of the projected visible area sigma(theta_i)."""
    theta = np.linspace(0, np.radians(89.5), 2000)
    w = from_angles(theta, 0)
    sigma = w[:, 2] * (1 + GgxNdf(alpha, alpha).smith_lambda(w))
    cumulative = np.concatenate([[0], np.cumsum(0.5 * (sigma[1:] + sigma[:-1]))])
    return np.interp(np.linspace(0, cumulative[-1], n), cumulative, theta)


def half_vectors(rows: int, columns: int) -> Array:
    """The grid's half vectors (rows, columns, 3), the light at azimuth 0."""
    v, u = np.linspace(0, 1, rows), np.linspace(0, 1, columns)
    theta, phi = np.broadcast_arrays(np.pi / 2 * u**2, 2 * np.pi * v[:, None])
    return from_angles(theta, phi)


def pdf_grid(theta_i: Array, alpha: float, rows: int, columns: int) -> Array:
    """p(v, u) = D_wi(h) sin(theta_h) pi u 2 pi of the GGX lobe, (T, rows, columns)."""
    h = half_vectors(rows, columns).reshape(-1, 3)
    u = np.tile(np.linspace(0, 1, columns), rows)
    area = np.sin(np.pi / 2 * u * u) * np.pi * u * 2 * np.pi
    ndf = GgxNdf(alpha, alpha)
    wi = from_angles(theta_i, 0)
    return np.stack([(ndf.pdf(np.broadcast_to(w, h.shape), h) * area).reshape(rows, columns) for w in wi])


def _area(u: Array, wi: Array, h: Array) -> Array:
    """|dwo / d(v, u)|, kept off 0 at the pole."""
    area = np.maximum(2 * np.pi**2 * u * np.sin(np.pi / 2 * u * u), 1e-12)
    return area * 4 * np.abs(np.einsum("ni,ni->n", wi, h))
