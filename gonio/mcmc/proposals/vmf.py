"""Spherical Gaussian (von Mises-Fisher) steps, thesis 3.1: each direction is drawn about where it was.

The density is (3.1), `brdf/models/spherical.py`, symmetric. Proposals below the horizon have weight 0: rejected, not
folded.
"""

import numpy as np

from gonio.brdf.models.spherical import sample_vmf
from gonio.geometry import Array, from_angles, from_half_diff, half_diff_jacobian, to_half_diff
from gonio.mcmc.proposals import GLOBAL

PI = np.pi


class Vmf:
    """Two directions (a, b) moved independently; u is both, (6, N). A global step draws both on the hemisphere."""

    uniforms, normals = 5, 0

    def __init__(self, *, kappa: float, global_share: float):
        self.kappa, self.global_share = kappa, global_share

    def propose(self, u: Array | None, uniform: Array, normal: Array) -> tuple[Array, Array]:
        coin, *r = uniform
        fresh = np.concatenate([_hemisphere(r[0], r[1]).T, _hemisphere(r[2], r[3]).T])
        if u is None:
            return fresh, np.full(len(coin), GLOBAL, np.int8)
        moved = np.concatenate(
            [sample_vmf(u[:3].T, self.kappa, r[0], r[1]).T, sample_vmf(u[3:].T, self.kappa, r[2], r[3]).T]
        )
        jump = coin < self.global_share
        return np.where(jump, fresh, moved), jump.view(np.int8)  # LOCAL = 0, GLOBAL = 1


class VmfIo(Vmf):
    """The step in (wi, wo)."""

    def place(self, u: Array) -> tuple[Array, Array, Array]:
        return *self.to_directions(u), self.log_jacobian(u)

    def to_directions(self, u: Array) -> tuple[Array, Array]:
        return u[:3].T.copy(), u[3:].T.copy()

    def from_directions(self, wi: Array, wo: Array) -> Array:
        return np.concatenate([wi.T, wo.T])

    def log_jacobian(self, u: Array) -> Array:
        return np.zeros(u.shape[1])


class VmfHd(Vmf):
    """The step in (h, d), d in the frame of h; |d(wi, wo) / d(h, d)| = 4 cos theta_d."""

    def place(self, u: Array) -> tuple[Array, Array, Array]:
        return *self.to_directions(u), self.log_jacobian(u)

    def to_directions(self, u: Array) -> tuple[Array, Array]:
        theta_h, phi_h = np.arctan2(np.hypot(u[0], u[1]), u[2]), np.arctan2(u[1], u[0])
        theta_d, phi_d = np.arctan2(np.hypot(u[3], u[4]), u[5]), np.arctan2(u[4], u[3])
        return from_half_diff(theta_h, phi_h, theta_d, phi_d)

    def from_directions(self, wi: Array, wo: Array) -> Array:
        theta_h, phi_h, theta_d, phi_d = to_half_diff(wi, wo)
        return np.concatenate([from_angles(theta_h, phi_h).T, from_angles(theta_d, phi_d).T])

    def log_jacobian(self, u: Array) -> Array:
        # d behind its own frame (u[5] < 0) is outside the coordinates: weight 0
        theta_d = np.arctan2(np.hypot(u[3], u[4]), u[5])
        with np.errstate(divide="ignore"):
            return np.log(np.where(u[5] > 0, half_diff_jacobian(theta_d), 0))


def _hemisphere(u1: Array, u2: Array) -> Array:
    r, phi = np.sqrt(u1 * (2 - u1)), 2 * PI * u2
    return np.stack([r * np.cos(phi), r * np.sin(phi), 1 - u1], -1)
