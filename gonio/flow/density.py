"""A flow as a density of pairs of directions, and of wo given wi: cube, mirror image and azimuth put together."""

import numpy as np

from gonio.flow.cubes import Cube, make_cube
from gonio.flow.flow import Flow
from gonio.geometry import Array

LOG_MIRRORED = np.log(2)
LOG_TURN = np.log(2 * np.pi)


class FlowDensity:
    """q(wi, wo), solid angles of both. Isotropic: turned by an even azimuth and mirrored with even odds."""

    kind = "flow_density"

    def __init__(self, flow: Flow, cube: Cube):
        self.flow, self.cube = flow, cube
        self.isotropic = cube.dimensions == 3

    def to_arrays(self) -> dict[str, Array]:
        cube = {
            "coordinates": np.array(self.cube.coordinates),
            "cube_alpha": np.array(getattr(self.cube, "alpha", 0.1)),
            "anisotropic": np.array(not self.isotropic),
        }
        return cube | self.flow.to_arrays()

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "FlowDensity":
        """Raises FlowError, KeyError."""
        cube = make_cube(str(d["coordinates"]), float(d["cube_alpha"]), bool(d["anisotropic"]))
        return cls(Flow.from_arrays(d), cube)

    def log_prob(self, wi: Array, wo: Array) -> Array:
        """log q (N,); both directions above the horizon."""
        x = self.cube.from_directions(wi, wo)
        log_q = self.flow.log_prob(x) - self.cube.log_jacobian(x, wi, wo)
        return log_q - (LOG_MIRRORED + LOG_TURN) if self.isotropic else log_q

    def sample(self, uniform: Array) -> tuple[Array, Array]:
        """wi, wo (N, 3) from uniform (5, N); wo may fall below the horizon in some cubes."""
        return self.placed(self.cube, self.flow.from_base(uniform[5 - self.cube.dimensions :].T)[0], uniform)

    def placed(self, cube: Cube, x: Array, uniform: Array) -> tuple[Array, Array]:
        """Directions of points x (N, D) of a cube; if isotropic, mirrored and turned by uniform[:2] (5, N)."""
        wi, wo = cube.to_directions(x)
        if self.isotropic:
            wo[uniform[0] < 0.5, 1] *= -1
            c, s = np.cos(2 * np.pi * uniform[1]), np.sin(2 * np.pi * uniform[1])
            wi, wo = _turned(wi, c, s), _turned(wo, c, s)
        return wi, wo

    def conditional(self, wi: Array, wo: Array) -> Array:
        """log p(wo | wi), solid angle of wo. Only of cubes whose leading coordinates are wi's."""
        x = self.cube.from_directions(wi, wo)
        # d(wi, wo)/d(x, azimuth): wi's own part is dmu = dx2, and 2 pi of azimuth if that is a coordinate
        log_p = self.flow.conditional(x) - self.cube.log_jacobian(x, wi, wo)
        return log_p - LOG_MIRRORED if self.isotropic else log_p + LOG_TURN

    def sample_conditional(self, wi: Array, u: Array) -> tuple[Array, Array]:
        """wo (N, 3) and log p(wo | wi), (N,), for uniform u (N, 2)."""
        x = np.zeros((len(wi), self.cube.dimensions))
        x[:, 2] = (wi[:, 0] ** 2 + wi[:, 1] ** 2) / (1 + wi[:, 2])
        azimuth = np.arctan2(wi[:, 1], wi[:, 0])
        mirror, u1 = None, u[:, 1]
        if self.isotropic:
            mirror, u1 = u1 < 0.5, 2 * u1 % 1
        else:
            x[:, 3] = azimuth / (2 * np.pi) % 1
        x[:, 0], x[:, 1] = u[:, 0], u1
        x, log_q = self.flow.conditional_draw(x)
        local_wi, wo = self.cube.to_directions(x)
        log_p = log_q - self.cube.log_jacobian(x, local_wi, wo)
        if mirror is None:
            return wo, log_p + LOG_TURN
        wo[mirror, 1] *= -1
        return _turned(wo, np.cos(azimuth), np.sin(azimuth)), log_p - LOG_MIRRORED


def _turned(w: Array, c: Array, s: Array) -> Array:
    return np.stack([c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1], w[:, 2]], 1)
