"""VNDF primary sample space (thesis 3.4): wi uniform on the hemisphere, h from the GGX normals visible from wi.

pdf (3.4) = 1 / (2 pi) D_wi(h) / (4 |wo.h|). h is the normalised sum of the (stretched) wi and a point of a spherical
cap (Dupuy & Benyoub, Sampling Visible GGX Normals with Spherical Caps, 2023). Coordinates: u1, u2 of the cap, u3 for
cos theta_i and, on an anisotropic surface, u4 for phi_i.
"""

import numpy as np

from gonio.brdf.models.ndf import GgxNdf
from gonio.geometry import Array, half_vector, reflect, to_angles, unit
from gonio.mcmc.proposals.cube import CubeStep
from gonio.mcmc.proposals.ggx_density import log_vndf
from gonio.mcmc.proposals.pss_simple import turn

PI = np.pi


class PssVndf:
    def __init__(
        self, alpha_x: float, alpha_y: float, *, anisotropic: bool, sigma: float, global_share: float, boundary: str
    ):
        self.ndf = GgxNdf(alpha_x, alpha_y)
        self.anisotropic = anisotropic
        # u2 is an azimuth of full period; u3 an elevation; u4 an azimuth again
        self.step = CubeStep(4 if anisotropic else 3, sigma, global_share, boundary, (1, 3) if anisotropic else (1,))
        self.uniforms, self.normals = self.step.uniforms, self.step.normals

    def propose(self, u: Array | None, uniform: Array, normal: Array) -> tuple[Array, Array]:
        return self.step(u, uniform, normal)

    def place(self, u: Array) -> tuple[Array, Array, Array]:
        wi, wo = self.to_directions(u)
        return wi, wo, -self.log_pdf(wi, wo)

    def to_directions(self, u: Array) -> tuple[Array, Array]:
        z = 1 - u[2]  # uniform on the hemisphere
        r = np.sqrt(u[2] * (2 - u[2]))
        phi_i = 2 * PI * u[3] if self.anisotropic else np.zeros_like(z)
        wi = np.stack([r * np.cos(phi_i), r * np.sin(phi_i), z], -1)
        h = self.ndf.sample(wi, u[:2].T)
        return wi, reflect(wi, h)

    def from_directions(self, wi: Array, wo: Array) -> Array:
        if not self.anisotropic:  # theta_i alone is a coordinate: the pair is turned until wi has azimuth 0
            wi, wo = wi.copy(), wo.copy()
            turn(wi, wo, -to_angles(wi)[1])
        scale = np.array([self.ndf.alpha_x, self.ndf.alpha_y, 1.0])
        v, m = unit(wi * scale), unit(half_vector(wi, wo) / scale)
        cap = reflect(v, m)
        u = [
            np.clip((1 - cap[:, 2]) / (1 + v[:, 2]), 0, 1),
            np.arctan2(cap[:, 1], cap[:, 0]) / (2 * PI) % 1,
            1 - wi[:, 2],
        ]
        if self.anisotropic:
            u.append(to_angles(wi)[1] / (2 * PI) % 1)
        return np.stack(u)

    def log_jacobian(self, u: Array) -> Array:
        """-log of (3.4), from the directions u stands for."""
        return -self.log_pdf(*self.to_directions(u))

    def log_pdf(self, wi: Array, wo: Array) -> Array:
        """log of (3.4), solid angles of wi and wo."""
        return log_vndf(wi, wo, self.ndf.alpha_x, self.ndf.alpha_y)[:, 0] - np.log(2 * PI)
