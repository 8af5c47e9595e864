"""Coordinates in which the residual of a reflectance is smooth: the peak stretched, no seam where phi_d means nothing.

    (asinh(theta_h / t0),  s sin(theta_d) cos(phi_d),  s sin(theta_d) |sin(phi_d)|,  e theta_d)

t0 is about the width of the peak. phi_d keeps its say at theta_h = 0, since the peaks of real samples do not sit there.
"""

from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.robust_base import Angles


@dataclass(frozen=True)
class Stretch:
    """t0 in radians; s = `azimuth`, e = `elevation`: how far apart unequal phi_d and theta_d are."""

    t0: float
    azimuth: float = 0.7
    elevation: float = 1.2

    def __call__(self, a: Angles) -> Array:
        """(N, 4)."""
        s = self.azimuth * np.sin(a.theta_d)
        return np.stack(
            [np.arcsinh(a.theta_h / self.t0), s * np.cos(a.phi_d), s * np.sin(a.phi_d), self.elevation * a.theta_d], 1
        )

    def measure(self, a: Angles) -> Array:
        """|dwi dwo| per volume of the stretched space, (N,): turns a count per volume into one per solid angles."""
        stretch = np.hypot(self.t0, a.theta_h)
        sheet = np.maximum(self.azimuth * np.hypot(self.azimuth * np.cos(a.theta_d), self.elevation), 1e-9)
        return 4 * np.cos(a.theta_d) * np.sin(a.theta_h) * stretch / sheet
