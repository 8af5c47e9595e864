"""Spherical Gaussian (von Mises-Fisher) steps, thesis 3.1: each direction is drawn about where it was.

Density kappa / (4 pi sinh kappa) exp(kappa mu.w) (3.1), symmetric in (mu, w). The cosine about mu is drawn by the
inverse of its cumulative in the form of Jakob (2012), which neither overflows at large kappa nor cancels at small:
1 - cos t = -log(1 - xi (1 - exp(-2 kappa))) / kappa. Proposals below the horizon have weight 0: rejected, not folded.
"""

import numpy as np

from gonio.geometry import Array, from_angles, from_half_diff, half_diff_jacobian, to_half_diff
from gonio.mcmc.proposals import GLOBAL

PI = np.pi


def log_vmf(cos_t: Array, kappa: float) -> Array:
    """log of (3.1) at the cosine cos_t about the mean direction, solid angle; stable for kappa in 1e-3 ... 1e6."""
    return np.log(kappa / (2 * PI)) - np.log(-np.expm1(-2 * kappa)) + kappa * (np.asarray(cos_t) - 1)


def log_vmf_between(mu: Array, w: Array, kappa: float) -> Array:
    """log of (3.1) from two unit vectors, by |mu - w|^2 = 2 (1 - cos t): exact where the two nearly agree."""
    return np.log(kappa / (2 * PI)) - np.log(-np.expm1(-2 * kappa)) - 0.5 * kappa * np.sum((mu - w) ** 2, -1)


def sample_vmf(mu: Array, kappa: float, u1: Array, u2: Array) -> Array:
    """Directions (N, 3) about unit vectors mu (N, 3)."""
    v = np.minimum(-np.log1p(u1 * np.expm1(-2 * kappa)) / kappa, 2.0)  # 1 - cos t
    sin_t = np.sqrt(v * (2 - v))
    phi = 2 * PI * u2
    # orthonormal basis of Duff et al. (2017), no branch but the sign of z
    x, y, z = mu.T
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    s = np.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    t = np.stack([b, sign + y * y * a, -y], -1)
    w = (sin_t * np.cos(phi))[:, None] * s + (sin_t * np.sin(phi))[:, None] * t + (1 - v)[:, None] * mu
    return w / np.linalg.norm(w, axis=1, keepdims=True)


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
