"""Simple primary sample space (thesis 3.3): theta_h = arcsin u1, theta_d = u2 pi/2, phi_d = u3 pi.

Four coordinates for an anisotropic surface: phi_d = u3 2 pi and phi_h = u4 2 pi.
|d(wi, wo) / du| = 2 pi^2 sin theta_h sin theta_d cos theta_d / cos theta_h is the reciprocal of (3.2): finite and
zero where that pdf is singular.
"""

import numpy as np

from gonio.geometry import Array, to_half_diff
from gonio.mcmc.proposals.cube import CubeStep

PI = np.pi


class PssSimple:
    def __init__(self, *, anisotropic: bool, sigma: float, global_share: float, boundary: str):
        self.anisotropic = anisotropic
        self.step = CubeStep(4 if anisotropic else 3, sigma, global_share, boundary, (2, 3) if anisotropic else ())
        self.uniforms, self.normals = self.step.uniforms, self.step.normals

    def propose(self, u: Array | None, uniform: Array, normal: Array) -> tuple[Array, Array]:
        return self.step(u, uniform, normal)

    def to_directions(self, u: Array) -> tuple[Array, Array]:
        sh = u[0]
        theta_d, phi_d = u[1] * (0.5 * PI), u[2] * (2 * PI if self.anisotropic else PI)
        ch = np.sqrt((1 - sh) * (1 + sh))
        cd, sd = np.cos(theta_d), np.sin(theta_d)
        tx, ty = sd * np.cos(phi_d), sd * np.sin(phi_d)
        # h = (sh, 0, ch) and d's tangential part (tx, ty) along (ch, 0, -sh) and y, for phi_h = 0
        hx, hz, dx, dz = cd * sh, cd * ch, tx * ch, tx * sh
        wi, wo = np.empty((u.shape[1], 3)), np.empty((u.shape[1], 3))
        wi[:, 0], wi[:, 1], wi[:, 2] = hx + dx, ty, hz - dz
        wo[:, 0], wo[:, 1], wo[:, 2] = hx - dx, -ty, hz + dz
        if self.anisotropic:
            turn(wi, wo, 2 * PI * u[3])
        return wi, wo

    def from_directions(self, wi: Array, wo: Array) -> Array:
        theta_h, phi_h, theta_d, phi_d = to_half_diff(wi, wo)
        u = [np.sin(theta_h), theta_d / (0.5 * PI)]
        if self.anisotropic:
            return np.stack([*u, phi_d / (2 * PI) % 1, phi_h / (2 * PI) % 1])
        return np.stack([*u, np.abs(phi_d) / PI])

    def log_jacobian(self, u: Array) -> Array:
        # sin theta_d cos theta_d = sin(pi u2) / 2; the tiny number keeps log 0 finite where the weight is 0 anyway
        return np.log(PI * PI * u[0] * np.abs(np.sin(PI * u[1])) / np.sqrt((1 - u[0]) * (1 + u[0]) + 1e-300) + 1e-300)


def turn(wi: Array, wo: Array, phi: Array) -> None:
    """Both directions turned about the normal by phi (N,), in place."""
    c, s = np.cos(phi), np.sin(phi)
    for w in (wi, wo):
        w[:, 0], w[:, 1] = c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1]
