"""Simple primary sample space (thesis 3.3): theta_h = arcsin u1, theta_d = u2 pi/2, phi_d = u3 pi.

Four coordinates for an anisotropic surface: phi_d = u3 2 pi and phi_h = u4 2 pi.
|d(wi, wo) / du| = 2 pi^2 sin theta_h sin theta_d cos theta_d / cos theta_h is the reciprocal of (3.2): finite and
zero where that pdf is singular.
"""

import numpy as np

from gonio.geometry import Array, to_half_diff
from gonio.mcmc.proposals.cube import CubeStep

PI = np.pi
TINY = 1e-300


class PssSimple:
    def __init__(self, *, anisotropic: bool, sigma: float, global_share: float, boundary: str):
        self.anisotropic = anisotropic
        self.step = CubeStep(4 if anisotropic else 3, sigma, global_share, boundary, (2, 3) if anisotropic else ())
        self._scale = np.array([[0.5 * PI], [2 * PI if anisotropic else PI]])
        self.uniforms, self.normals = self.step.uniforms, self.step.normals

    def propose(self, u: Array | None, uniform: Array, normal: Array) -> tuple[Array, Array]:
        return self.step(u, uniform, normal)

    def place(self, u: Array) -> tuple[Array, Array, Array]:
        wi, wo, sin_cos = self._directions(u[0], u)
        return wi, wo, self._log_jacobian(u[0], sin_cos)

    def to_directions(self, u: Array) -> tuple[Array, Array]:
        return self._directions(u[0], u)[:2]

    def log_jacobian(self, u: Array) -> Array:
        return self._log_jacobian(u[0], 0.5 * np.sin(PI * u[1]))

    def _directions(self, sh: Array, u: Array) -> tuple[Array, Array, Array]:
        """wi, wo and sin theta_d cos theta_d for sin theta_h = sh and the other coordinates of u."""
        angles = u[1:3] * self._scale
        ch = np.sqrt((1 - sh) * (1 + sh))
        (sd, sp), (cd, cp) = np.sin(angles), np.cos(angles)
        # h = (sh, 0, ch), and d's tangential part (tx, ty) along (ch, 0, -sh) and y, for phi_h = 0
        tx, hx, hz = sd * cp, cd * sh, cd * ch
        dx, dy, dz = tx * ch, sd * sp, tx * sh
        pair = np.empty((2, 3, len(sh)))
        np.add(hx, dx, pair[0, 0])
        np.subtract(hx, dx, pair[1, 0])
        pair[0, 1] = dy
        np.negative(dy, pair[1, 1])
        np.subtract(hz, dz, pair[0, 2])
        np.add(hz, dz, pair[1, 2])
        wi, wo = pair[0].T, pair[1].T
        if self.anisotropic:
            turn(wi, wo, 2 * PI * u[3])
        return wi, wo, sd * cd

    def _log_jacobian(self, sh: Array, sin_cos: Array) -> Array:
        # rounding may put theta_d a hair past pi/2; the tiny number keeps log 0 finite, its weight is 0 anyway
        return np.log(2 * PI * PI * sh * np.abs(sin_cos) / np.sqrt((1 - sh) * (1 + sh) + TINY) + TINY)

    def from_directions(self, wi: Array, wo: Array) -> Array:
        theta_h, phi_h, theta_d, phi_d = to_half_diff(wi, wo)
        u = [np.sin(theta_h), theta_d / (0.5 * PI)]
        if self.anisotropic:
            return np.stack([*u, phi_d / (2 * PI) % 1, phi_h / (2 * PI) % 1])
        return np.stack([*u, np.abs(phi_d) / PI])


def turn(wi: Array, wo: Array, phi: Array) -> None:
    """Both directions turned about the normal by phi (N,), in place."""
    c, s = np.cos(phi), np.sin(phi)
    for w in (wi, wo):
        w[:, 0], w[:, 1] = c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1]
