"""Directions drawn in proportion to f cos(theta_o): marginal-conditional tables over half vectors, one per incidence.

Half vectors of an incidence: theta_h = t0 sinh(u L), L = asinh(pi/2 / t0), and phi_h - phi_i = 2 pi v; the density is
constant in each cell of the (u, v) square. Between two incidences it is their mixture, weights linear in theta_i, and
mixed with a share of cosine-weighted directions, so that it is above 0 wherever f is. `pdf` is exact: the very mixture.
"""

import numpy as np

from gonio.brdf.lambert import cosine_hemisphere
from gonio.geometry import Array, from_angles, half_vector, reflect, to_angles

COSINE = 0.1
INCIDENCES = np.radians(np.array([0, 5, 10, 20, 30, 40, 48, 55, 61, 66, 70, 74, 77, 80, 82.5, 85, 87, 89]))
CELLS = (64, 48)


class HalfGrid:
    """mass (I, U, V) of the cells, each incidence summing to 1; t0 in radians."""

    def __init__(self, mass: Array, t0: float):
        self.mass, self.t0 = mass, t0
        count, self._u, self._v = mass.shape
        self._length = np.arcsinh(np.pi / 2 / t0)
        flat = mass.reshape(count, -1)
        flat = flat / flat.sum(1, keepdims=True)
        self._density = flat.reshape(mass.shape) * self._u * self._v
        # one sorted list for all incidences: row i lives in [i, i + 1]
        cumulative = np.cumsum(flat, 1)
        cumulative /= cumulative[:, -1:]
        self._cumulative = cumulative
        self._sorted = (cumulative + np.arange(count)[:, None]).ravel()

    @classmethod
    def of(cls, evaluate, t0: float) -> "HalfGrid":
        """The tables of f cos(theta_o) for `evaluate(wi, wo) -> (N, C)`, channels weighed alike."""
        grid = cls(np.ones((len(INCIDENCES), *CELLS)), t0)
        # four points to a cell: a peak's flank is not missed
        u = (np.arange(2 * CELLS[0]) + 0.5) / (2 * CELLS[0])
        v = (np.arange(2 * CELLS[1]) + 0.5) / (2 * CELLS[1])
        u, v = (q.ravel() for q in np.meshgrid(u, v, indexing="ij"))
        mass = []
        for theta_i in INCIDENCES:
            wi = np.broadcast_to(from_angles(theta_i, 0.0), (len(u), 3))
            h = grid._half_vectors(u, v, np.zeros(len(u)))
            wo = reflect(wi, h)
            up = (wo[:, 2] > 0) & (np.einsum("ni,ni->n", wi, h) > 0)
            value = np.zeros(len(u))
            f = evaluate(wi[up], wo[up])
            f = (f / np.maximum(f.mean(0), 1e-300)).mean(1)
            dot = np.einsum("ni,ni->n", wi[up], h[up])
            value[up] = f * wo[up, 2] * 4 * dot * grid._jacobian(u[up])
            value = value.reshape(CELLS[0], 2, CELLS[1], 2).mean((1, 3))
            # a cell next to a full one may hold what its four points missed
            mass.append(value + 1e-3 * value.mean() * (value > 0) if value.sum() > 0 else np.ones(CELLS))
        return cls(np.stack(mass), t0)

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        wi, u = np.atleast_2d(wi), np.atleast_2d(u)
        theta_i, phi_i = to_angles(wi)
        low, part = self._slices(theta_i)
        cosine = u[:, 0] < COSINE
        x = np.where(cosine, u[:, 0] / COSINE, (u[:, 0] - COSINE) / (1 - COSINE))
        upper = u[:, 1] < part
        y = np.where(upper, u[:, 1] / np.where(part > 0, part, 1), (u[:, 1] - part) / np.where(part < 1, 1 - part, 1))
        row = low + upper
        cell = np.searchsorted(self._sorted, row + x, "right") - row * self._u * self._v
        cell = np.clip(cell, 0, self._u * self._v - 1)
        before = np.where(cell > 0, self._cumulative[row, cell - 1], 0)
        inside = np.clip((x - before) / np.maximum(self._cumulative[row, cell] - before, 1e-300), 0, 1 - 1e-12)
        i, j = np.divmod(cell, self._v)
        h = self._half_vectors((i + inside) / self._u, (j + y) / self._v, phi_i)
        wo = np.where(cosine[:, None], cosine_hemisphere(np.stack([x, u[:, 1]], -1)), reflect(wi, h))
        return wo, self.pdf(wi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        wi, wo = np.atleast_2d(wi), np.atleast_2d(wo)
        out = np.zeros(len(wi))
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        wi, wo = wi[up], wo[up]
        h = half_vector(wi, wo)
        theta_h, phi_h = to_angles(h)
        theta_i, phi_i = to_angles(wi)
        u = np.arcsinh(theta_h / self.t0) / self._length
        v = np.mod((phi_h - phi_i) / (2 * np.pi), 1)
        i = np.clip((u * self._u).astype(int), 0, self._u - 1)
        j = np.clip((v * self._v).astype(int), 0, self._v - 1)
        low, part = self._slices(theta_i)
        cells = (1 - part) * self._density[low, i, j] + part * self._density[low + 1, i, j]
        jacobian = np.maximum(self._jacobian(u) * 4 * np.einsum("ni,ni->n", wi, h), 1e-300)
        out[up] = COSINE * wo[:, 2] / np.pi + (1 - COSINE) * cells / jacobian
        return out

    def _slices(self, theta_i: Array):
        low = np.clip(np.searchsorted(INCIDENCES, theta_i, "right") - 1, 0, len(INCIDENCES) - 2)
        part = (theta_i - INCIDENCES[low]) / (INCIDENCES[low + 1] - INCIDENCES[low])
        return low, np.clip(part, 0, 1)

    def _half_vectors(self, u: Array, v: Array, phi_i: Array) -> Array:
        return from_angles(self.t0 * np.sinh(u * self._length), phi_i + 2 * np.pi * v)

    def _jacobian(self, u: Array) -> Array:
        """Solid angle of h per area of the (u, v) square."""
        theta_h = self.t0 * np.sinh(u * self._length)
        return 2 * np.pi * np.sin(theta_h) * np.hypot(self.t0, theta_h) * self._length
