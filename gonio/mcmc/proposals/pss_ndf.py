"""Primary sample space that stretches a glossy peak: theta_h by the cumulative of the GGX distribution.

u1 = tan^2 theta_h / (alpha^2 + tan^2 theta_h), theta_d = u2 pi/2, phi_d = u3 pi; anisotropic: 2 pi u3, phi_h = 2 pi u4.
The space of `auto`'s local moves: a step of fixed size in u1 is small at the peak and large in the tail.
"""

import numpy as np

from gonio.geometry import Array
from gonio.mcmc.proposals.pss_simple import PI, PssSimple


class PssNdf(PssSimple):
    def __init__(
        self, alpha: float, *, anisotropic: bool, sigma: float, global_share: float, boundary: str = "reflect"
    ):
        super().__init__(anisotropic=anisotropic, sigma=sigma, global_share=global_share, boundary=boundary)
        self.alpha = alpha

    def place(self, u: Array) -> tuple[Array, Array, Array]:
        wi, wo = self.to_directions(u)
        return wi, wo, self.log_jacobian(u)

    def to_directions(self, u: Array) -> tuple[Array, Array]:
        t2 = self._tan2(u)
        return self._directions(np.sqrt(t2 / (1 + t2)), u)[:2]

    def from_directions(self, wi: Array, wo: Array) -> Array:
        u = super().from_directions(wi, wo)
        t2 = u[0] ** 2 / np.maximum((1 - u[0]) * (1 + u[0]), 1e-300)
        u[0] = t2 / (self.alpha**2 + t2)
        return u

    def log_jacobian(self, u: Array) -> Array:
        # sin theta_h dtheta_h / du1 = (alpha^2 + tan^2)^2 / (2 alpha^2 (1 + tan^2)^(3/2))
        a2, t2 = self.alpha**2, self._tan2(u)
        polar = 2 * np.log(a2 + t2) - np.log(2 * a2) - 1.5 * np.log1p(t2)
        return polar + np.log(2 * PI * PI * np.abs(np.sin(PI * u[1])) + 1e-300)

    def _tan2(self, u: Array) -> Array:
        return self.alpha**2 * u[0] / np.maximum(1 - u[0], 1e-15)
