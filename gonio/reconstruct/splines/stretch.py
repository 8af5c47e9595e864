"""Coordinates in which the residual of a reflectance is smooth: peak and horizon stretched, no seam at theta_d = 0.

    asinh(theta_h / t0),  s sin(theta_d) cos(phi_d),  s sin(theta_d) |sin(phi_d)|,
    e (theta_d - q ln(cos(theta_d) + c)),  r ln((cos_o + c') / (cos_i + c'))

t0 is about the width of the peak. phi_d keeps its say at theta_h = 0, since the peaks of real samples do not sit there.
The fourth coordinate spends length towards grazing, where Fresnel and masking change fast; the fifth tells a pair from
its mirror in reciprocity and a wo near the horizon from one that is not. docs/reconstruction.md: what each is worth.
"""

from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.splines.robust_base import Angles

GRAZING, GRAZING_AT = 1.2, 0.08
RATIO, RATIO_AT = 0.3, 0.02


@dataclass(frozen=True)
class Stretch:
    """t0 in radians; s = `azimuth`, e = `elevation`: how far apart unequal phi_d and theta_d are."""

    t0: float
    azimuth: float = 0.7
    elevation: float = 0.55
    dimensions = 3

    def __call__(self, a: Angles) -> Array:
        """(N, 5)."""
        s = self.azimuth * np.sin(a.theta_d)
        sheet = [s * np.cos(a.phi_d), s * np.sin(a.phi_d), self.elevation * grazing(a.theta_d)]
        return np.stack([np.arcsinh(a.theta_h / self.t0), *sheet, ratio(a.cos_i, a.cos_o)], 1)

    def measure(self, a: Angles) -> Array:
        """|dwi dwo| per volume of the first four coordinates, (N,): a volume becomes solid angles."""
        return np.sin(a.theta_h) * np.hypot(self.t0, a.theta_h) * solid_angle(a.theta_d, self.azimuth, self.elevation)


def grazing(theta_d: Array) -> Array:
    """theta_d, longer towards grazing."""
    return theta_d - GRAZING * np.log(np.cos(theta_d) + GRAZING_AT)


def ratio(cos_i: Array, cos_o: Array) -> Array:
    return RATIO * np.log((cos_o + RATIO_AT) / (cos_i + RATIO_AT))


def solid_angle(theta_d: Array, azimuth: float, elevation: float) -> Array:
    """4 cos(theta_d) |dd| per area of the sheet of d's three coordinates."""
    s, c = np.sin(theta_d), np.cos(theta_d)
    return 4 * c / (azimuth * np.hypot(azimuth * c, elevation * (1 + GRAZING * s / (c + GRAZING_AT))))
