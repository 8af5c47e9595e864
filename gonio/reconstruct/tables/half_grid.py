"""Directions drawn in proportion to f cos(theta_o): marginal-conditional tables over half vectors, one per incidence.

Half vectors of an incidence: theta_h = t0 sinh(u L), L = asinh(pi/2 / t0), and phi_h = 2 pi v from the azimuth of wi
(isotropic) or from the sample's x axis (anisotropic); the density is constant in each cell of the (u, v) square.
Between incidences it is their mixture, weights linear in theta_i and phi_i, and all of it is mixed with a share of
cosine-weighted directions, so that it is above 0 wherever f is. `pdf` is exact: the very mixture.
"""

import numpy as np

from gonio.brdf.models.lambert import cosine_hemisphere
from gonio.geometry import Array, from_angles, half_vector, reflect, to_angles

COSINE = 0.1
INCIDENCES = np.radians(np.array([0, 5, 10, 20, 30, 40, 48, 55, 61, 66, 70, 74, 77, 80, 82.5, 85, 87, 89]))
CELLS = (64, 48)


class HalfGrid:
    """mass (I, A, U, V) of the cells for I incidences and A azimuths of wi (1: isotropic); t0 in radians."""

    def __init__(self, mass: Array, t0: float):
        self.mass, self.t0 = mass, t0
        _, self.azimuths, self._u, self._v = mass.shape
        self._length = np.arcsinh(np.pi / 2 / t0)
        flat = mass.reshape(-1, self._u * self._v)
        flat = flat / flat.sum(1, keepdims=True)
        self._density = flat.reshape(-1, self._u, self._v) * self._u * self._v
        # one sorted list for all rows: row i lives in [i, i + 1]
        self._cumulative = np.cumsum(flat, 1)
        self._cumulative /= self._cumulative[:, -1:]
        self._sorted = (self._cumulative + np.arange(len(flat))[:, None]).ravel()

    @classmethod
    def of(cls, evaluate, t0: float, azimuths: int = 1) -> "HalfGrid":
        """The tables of f cos(theta_o) for `evaluate(wi, wo) -> (N, C)`, channels weighed alike."""
        grid = cls(np.ones((len(INCIDENCES), azimuths, *CELLS)), t0)
        # four points to a cell: a peak's flank is not missed
        u = (np.arange(2 * CELLS[0]) + 0.5) / (2 * CELLS[0])
        v = (np.arange(2 * CELLS[1]) + 0.5) / (2 * CELLS[1])
        u, v = (q.ravel() for q in np.meshgrid(u, v, indexing="ij"))
        h = grid._half_vectors(u, v, np.zeros(len(u)))
        jacobian = grid._jacobian(u)
        mass = np.ones_like(grid.mass)
        for i, theta_i in enumerate(INCIDENCES):
            for j in range(azimuths):
                wi = np.broadcast_to(from_angles(theta_i, 2 * np.pi * j / azimuths), (len(u), 3))
                wo = reflect(wi, h)
                dot = np.einsum("ni,ni->n", wi, h)
                up = (wo[:, 2] > 0) & (dot > 0)
                f = evaluate(wi[up], wo[up])
                value = np.zeros(len(u))
                value[up] = (f / np.maximum(f.mean(0), 1e-300)).mean(1) * wo[up, 2] * 4 * dot[up] * jacobian[up]
                value = value.reshape(CELLS[0], 2, CELLS[1], 2).mean((1, 3))
                if value.sum() > 0:
                    # a cell beside the horizon may hold what its four points missed
                    mass[i, j] = value + 1e-3 * value.mean() * (value > 0)
        return cls(mass, t0)

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        wi, u = np.atleast_2d(wi), np.atleast_2d(u)
        _, phi_i = to_angles(wi)
        cosine = u[:, 0] < COSINE
        x = np.where(cosine, u[:, 0] / COSINE, (u[:, 0] - COSINE) / (1 - COSINE))
        # which of the incidences around wi: by the second number, which is stretched again to be used again
        y, row = u[:, 1].copy(), np.full(len(wi), -1)
        left = np.zeros(len(wi))
        for candidate, weight in self._rows(wi):
            mine = (row < 0) & (u[:, 1] < left + weight)
            row[mine] = candidate[mine]
            y[mine] = np.clip((u[mine, 1] - left[mine]) / weight[mine], 0, 1 - 1e-12)
            left = left + weight
        row = np.where(row < 0, candidate, row)
        cells = self._u * self._v
        cell = np.clip(np.searchsorted(self._sorted, row + x, "right") - row * cells, 0, cells - 1)
        before = np.where(cell > 0, self._cumulative[row, cell - 1], 0)
        inside = np.clip((x - before) / np.maximum(self._cumulative[row, cell] - before, 1e-300), 0, 1 - 1e-12)
        i, j = np.divmod(cell, self._v)
        origin = phi_i if self.azimuths == 1 else 0 * phi_i
        h = self._half_vectors((i + inside) / self._u, (j + y) / self._v, origin)
        wo = np.where(cosine[:, None], cosine_hemisphere(np.stack([x, u[:, 1]], -1)), reflect(wi, h))
        return wo, self.pdf(wi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        wi, wo = np.atleast_2d(wi), np.atleast_2d(wo)
        out = np.zeros(len(wi))
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        wi, wo = wi[up], wo[up]
        h = half_vector(wi, wo)
        theta_h, phi_h = to_angles(h)
        u = np.arcsinh(theta_h / self.t0) / self._length
        origin = to_angles(wi)[1] if self.azimuths == 1 else 0
        v = np.mod((phi_h - origin) / (2 * np.pi), 1)
        i = np.clip((u * self._u).astype(int), 0, self._u - 1)
        j = np.clip((v * self._v).astype(int), 0, self._v - 1)
        cells = sum(weight * self._density[row, i, j] for row, weight in self._rows(wi))
        jacobian = np.maximum(self._jacobian(u) * 4 * np.einsum("ni,ni->n", wi, h), 1e-300)
        out[up] = COSINE * wo[:, 2] / np.pi + (1 - COSINE) * cells / jacobian
        return out

    def _rows(self, wi: Array) -> list[tuple[Array, Array]]:
        """The tables that each wi draws from and their weights: two, or four with azimuths."""
        theta_i, phi_i = to_angles(wi)
        low = np.clip(np.searchsorted(INCIDENCES, theta_i, "right") - 1, 0, len(INCIDENCES) - 2)
        part = np.clip((theta_i - INCIDENCES[low]) / (INCIDENCES[low + 1] - INCIDENCES[low]), 0, 1)
        slices = [(low, 1 - part), (low + 1, part)]
        if self.azimuths == 1:
            return slices
        turn = np.mod(phi_i / (2 * np.pi), 1) * self.azimuths
        first = np.minimum(turn.astype(int), self.azimuths - 1)
        rest = turn - first
        around = [(first, 1 - rest), ((first + 1) % self.azimuths, rest)]
        return [(k * self.azimuths + a, p * q) for k, p in slices for a, q in around]

    def _half_vectors(self, u: Array, v: Array, phi: Array) -> Array:
        return from_angles(self.t0 * np.sinh(u * self._length), phi + 2 * np.pi * v)

    def _jacobian(self, u: Array) -> Array:
        """Solid angle of h per area of the (u, v) square."""
        theta_h = self.t0 * np.sinh(u * self._length)
        return 2 * np.pi * np.sin(theta_h) * np.hypot(self.t0, theta_h) * self._length
