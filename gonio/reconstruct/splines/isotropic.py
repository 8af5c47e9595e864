"""The frame of an isotropic sample: which angles a pair has, how they are stretched, how they index a table."""

from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.splines.robust_base import Angles
from gonio.reconstruct.splines.stretch import Stretch
from gonio.reconstruct.tables.lookup import nodes

GRAZING, GRAZING_AT = 0.3, 0.08
_THETA_D = np.linspace(0, np.pi / 2, 4001)
_AXIS = _THETA_D - GRAZING * np.log(np.cos(_THETA_D) + GRAZING_AT)
_AXIS = (_AXIS - _AXIS[0]) / (_AXIS[-1] - _AXIS[0])


class Isotropic:
    """Only the azimuth between wi and wo counts, and not its sign."""

    def angles(self, wi: Array, wo: Array) -> Angles:
        return Angles.of(wi, wo)

    def stretch(self, t0: float, azimuth: float = 0.7, elevation: float = 0.55) -> Stretch:
        return Stretch(t0, azimuth, elevation)

    def chart(self, t0: float) -> "Chart":
        return Chart(t0)

    def to_arrays(self) -> dict[str, Array]:
        return {}


@dataclass(frozen=True)
class Chart:
    """(theta_h, theta_d, |phi_d|) <-> [0, 1]^3; t0 in radians."""

    t0: float
    periodic = (False, False, False)
    coarse, refine = (128, 64, 40), (2, 2, 2)
    spread = (32, 24, 12)

    def __call__(self, a: Angles) -> Array:
        return np.stack([radius(a.theta_h, self.t0), elevation(a.theta_d), a.phi_d / np.pi], 1)

    def nodes(self, n: tuple[int, ...]) -> tuple[Angles, Array]:
        """Angles of all nodes, row by row, and the cosine of the lower direction with the normal."""
        u, v, w = (q.ravel() for q in np.meshgrid(*(nodes(k, False) for k in n), indexing="ij"))
        theta_h, theta_d, phi_d = theta_h_of(u, self.t0), theta_d_of(v), np.pi * w
        upright = np.cos(theta_h) * np.cos(theta_d)
        across = np.sin(theta_h) * np.sin(theta_d) * np.cos(phi_d)
        cos_i, cos_o = upright - across, upright + across
        a = Angles(theta_h, theta_d, phi_d, np.maximum(cos_i, 1e-6), np.maximum(cos_o, 1e-6))
        return a, np.minimum(cos_i, cos_o)


def radius(theta_h: Array, t0: float) -> Array:
    return np.arcsinh(theta_h / t0) / np.arcsinh(np.pi / 2 / t0)


def theta_h_of(u: Array, t0: float) -> Array:
    """The inverse of `radius`."""
    return t0 * np.sinh(u * np.arcsinh(np.pi / 2 / t0))


def elevation(theta_d: Array) -> Array:
    """theta_d as a table's axis, a little longer towards grazing."""
    return np.interp(theta_d, _THETA_D, _AXIS)


def theta_d_of(v: Array) -> Array:
    """The inverse of `elevation`."""
    return np.interp(v, _AXIS, _THETA_D)
