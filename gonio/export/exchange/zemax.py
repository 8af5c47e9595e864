"""Any `Brdf` as Zemax's Tabular BSDF text, `.bsdf`: what `gonio.importing.zemax` describes and reads.

XYZ of a 3-channel (linear sRGB) BRDF, Monochrome of a grey one. Radial angles follow the width of the lobe, from a
sixth of it on in equal ratios. An entry below the horizon holds what lies at the horizon before it, so that nothing is
lost in between; readers do not use it. TIS is the directional-hemispherical reflectance.
"""

import os

import numpy as np

from gonio.atomic import write_text
from gonio.brdf import Brdf
from gonio.export import ExportError, checked
from gonio.export.exchange.lattice import Lattice, reflectances, say_loss
from gonio.export.mountain import RGB_TO_XYZ
from gonio.export.profile import half_profile, half_width, turns
from gonio.geometry import Array, from_angles

INCIDENCE_DEG = (
    0.0,
    5.0,
    10.0,
    15.0,
    20.0,
    25.0,
    30.0,
    35.0,
    40.0,
    45.0,
    50.0,
    55.0,
    60.0,
    65.0,
    70.0,
    75.0,
    80.0,
    85.0,
)
RADIALS = 48
AZIMUTHS = 37  # over half a turn
ROTATIONS_DEG = tuple(np.arange(0.0, 360.0, 20.0))
HORIZON = 0.01  # z of the lowest direction that is asked for


def write_zemax(brdf: Brdf, path: str | os.PathLike) -> None:
    """Whole or not at all. Warns (ExportWarning) of what it cannot hold.

    Raises ExportError for NaN, negative values, or other than 1 or 3 channels.
    """
    if brdf.channels not in (1, 3):
        raise ExportError(f"the BRDF has {brdf.channels} channels, the format holds 1 or 3; nothing was written")
    anisotropic = turns(brdf)
    incidence = np.radians(INCIDENCE_DEG)
    radial = radials(brdf)
    azimuth = np.linspace(0, 2 * np.pi if anisotropic else np.pi, 2 * AZIMUTHS - 1 if anisotropic else AZIMUTHS)
    rotation = np.radians(ROTATIONS_DEG) if anisotropic else np.zeros(1)
    f = _values(brdf, rotation, incidence, azimuth, radial)
    # the referee's light is at azimuth 0: the first rotation tells
    say_loss(Lattice(_coordinates(anisotropic), (incidence, azimuth, radial), f[0]), brdf, "this table of Zemax's")
    values = f @ RGB_TO_XYZ.T if brdf.channels == 3 else f
    tis = [reflectances(_Turned(brdf, r), incidence) for r in rotation]
    write_text(path, _text(values, tis, rotation, incidence, azimuth, radial, anisotropic))


def radials(brdf: Brdf) -> Array:
    """0 and angles in equal ratios, from a sixth of the lobe's width to where nothing is above the horizon."""
    width = half_width(half_profile(brdf, 512, 2))
    first = float(np.clip(2 * width / 6, np.radians(0.02), np.radians(2)))
    return np.concatenate([[0.0], np.geomspace(first, np.radians(175.0), RADIALS - 1)])


class _Turned:
    """The BRDF with the light's azimuth at phi."""

    def __init__(self, brdf: Brdf, phi: float):
        self._brdf, self._turn = (
            brdf,
            np.array([[np.cos(phi), np.sin(phi), 0], [-np.sin(phi), np.cos(phi), 0], [0, 0, 1]]),
        )

    def eval(self, wi: Array, wo: Array) -> Array:
        return self._brdf.eval(wi @ self._turn, wo @ self._turn)

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        wo, pdf = self._brdf.sample(wi @ self._turn, u)
        return wo @ self._turn.T, pdf


def _values(brdf: Brdf, rotation: Array, incidence: Array, azimuth: Array, radial: Array) -> Array:
    """(rotations, incidences, azimuths, radials, C)."""
    i, a, r = (x.ravel() for x in np.meshgrid(incidence, azimuth, radial, indexing="ij"))
    w = from_angles(r, a)
    c, s = np.cos(i), np.sin(i)
    wo = np.stack([w[:, 0] * c - w[:, 2] * s, w[:, 1], w[:, 0] * s + w[:, 2] * c], 1)
    low = wo[:, 2] < HORIZON
    wo[low, 2] = HORIZON
    wo /= np.linalg.norm(wo, axis=1, keepdims=True)
    wi = from_angles(i, np.zeros_like(i))
    shape = (len(incidence), len(azimuth), len(radial), brdf.channels)
    return np.stack([checked(_Turned(brdf, phi), wi, wo).reshape(shape) for phi in rotation])


def _coordinates(anisotropic: bool):
    """wi, wo -> theta_i, azimuth (to pi, or 2 pi if anisotropic), radial angle: the inverse of what `_values` does."""
    return lambda wi, wo: _about_mirror(wi, wo, anisotropic)


def _about_mirror(wi: Array, wo: Array, whole_turn: bool) -> tuple[Array, Array, Array]:
    theta = np.arctan2(np.hypot(wi[:, 0], wi[:, 1]), wi[:, 2])
    phi = np.arctan2(wi[:, 1], wi[:, 0])
    x = wo[:, 0] * np.cos(phi) + wo[:, 1] * np.sin(phi)
    y = wo[:, 1] * np.cos(phi) - wo[:, 0] * np.sin(phi)
    c, s = np.cos(theta), np.sin(theta)
    u, w = x * c + wo[:, 2] * s, wo[:, 2] * c - x * s
    azimuth = np.arctan2(y, u) % (2 * np.pi) if whole_turn else np.arctan2(np.abs(y), u)
    return theta, azimuth, np.arctan2(np.hypot(u, y), w)


def _text(values: Array, tis: list[Array], rotation, incidence, azimuth, radial, anisotropic: bool) -> str:
    colours = values.shape[-1]
    lines = ["# written by gonio", "Source  Measured"]
    lines.append(f"Symmetry  {'ASymmetrical4D' if anisotropic else 'PlaneSymmetrical'}")
    lines.append(f"SpectralContent  {'XYZ' if colours == 3 else 'Monochrome'}")
    lines.append("ScatterType  BRDF")
    for key, angles in (
        ("SampleRotation", rotation),
        ("AngleOfIncidence", incidence),
        ("ScatterAzimuth", azimuth),
        ("ScatterRadial", radial),
    ):
        lines += [f"{key}  {len(angles)}", "\t".join(f"{a:.7g}" for a in np.degrees(angles))]
    lines.append("")
    for c in range(colours):
        lines += [f"Tristimulus{'XYZ'[c]}" if colours == 3 else "Monochrome", "DataBegin"]
        for k in range(len(rotation)):
            total = tis[k] @ RGB_TO_XYZ.T if colours == 3 else tis[k]
            for j in range(len(incidence)):
                lines.append(f"TIS {total[j, c]:.6g}")
                lines += ["\t".join(f"{v:.6e}" for v in row) for row in values[k, j, :, :, c]]
        lines.append("DataEnd")
    return "\n".join(lines) + "\n"
