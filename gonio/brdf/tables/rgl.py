"""The BRDF tables of the RGL material database (Dupuy and Jakob 2018): the `.bsdf` model, isotropic and anisotropic.

A table holds, per incidence (phi_i, theta_i), the visible-normal density over the square of half vectors
u_m = (sqrt(2 theta_m / pi), phi_m / 2pi) and, on the square that this density warps to, a luminance (a density) and
the colours. What is stored is f cos(theta_o) 4 sigma(wi) / D(m) where `jacobian` is 1. Colours are `rgb`, or
`spectra` at `wavelengths` (nm). `theta_i` beyond the grid takes the nearest slice.
"""

import os
from typing import BinaryIO

import numpy as np

from gonio.brdf.base import BrdfFileError
from gonio.brdf.tables.tensor_file import read_tensor_file
from gonio.brdf.tables.warp import Corners, Interpolant, ParameterGrid, Warp
from gonio.geometry import Array, directions, half_vector, reflect, to_angles

POLE = 1e-4  # the density is evaluated no nearer to x = 0, where it is 0/0
CHUNK = 8192  # pairs at a time: the working set stays in the processor's cache


class RglBrdf:
    """An RGL table as a `Brdf`. `fields` are those of the file; `name` is what errors call it.

    Isotropic with one or two azimuths phi_i (the first is used). `wavelengths` is None for rgb tables.
    Negative colours (out of gamut) are 0. Raises BrdfFileError where a field is missing, misshapen or not a number.
    """

    kind = "rgl"

    def __init__(self, fields: dict[str, Array], name: str = "RGL table"):
        colours = check_fields(fields, name)
        self.fields, self.name = fields, name
        self.theta_i, self.phi_i = (np.asarray(fields[k], float) for k in ("theta_i", "phi_i"))
        self.isotropic = len(self.phi_i) <= 2
        self.wavelengths = np.asarray(fields["wavelengths"], float) if colours == "spectra" else None
        self.description = bytes(fields["description"]).decode(errors="replace") if "description" in fields else ""
        rows = slice(0, 1) if self.isotropic else slice(None)
        azimuths = self.phi_i[rows]
        # a table over half or a quarter of the azimuths stands for the whole by symmetry
        self.reduction = 1 if self.isotropic else max(1, round(2 * np.pi / (azimuths[-1] - azimuths[0])))
        self.grid = ParameterGrid(azimuths, self.theta_i)

        def slices(key: str) -> Array:
            a = np.asarray(fields[key][rows], float)
            return a.reshape(self.grid.size, *a.shape[2:])

        self.vndf = Warp(slices("vndf"))
        self.luminance = Warp(np.maximum(slices("luminance"), 0))  # as published it dips below 0 here and there
        self.colour = Interpolant(np.moveaxis(slices(colours), 1, -1))
        self.ndf = Interpolant(np.asarray(fields["ndf"], float)[None, :, :, None])
        self.sigma = Interpolant(np.asarray(fields["sigma"], float)[None, :, :, None])
        self.jacobian = bool(fields["jacobian"].ravel()[0])

    @classmethod
    def from_file(cls, source: str | os.PathLike | BinaryIO, name: str | None = None) -> "RglBrdf":
        name = name or (str(source) if isinstance(source, str | os.PathLike) else "RGL table")
        return cls(read_tensor_file(source, name), name)

    @property
    def channels(self) -> int:
        return self.colour.channels

    def to_arrays(self) -> dict[str, Array]:
        return dict(self.fields)

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "RglBrdf":
        return cls(d)

    def eval(self, wi: Array, wo: Array) -> Array:
        """f (N, C) in 1/sr: the table's value over cos(theta_o)."""
        wi, wo = directions(wi), directions(wo)
        out = np.zeros((len(wi), self.channels))
        above = np.flatnonzero((wi[:, 2] > 0) & (wo[:, 2] > 0))
        for at in range(0, len(above), CHUNK):
            k = above[at : at + CHUNK]
            out[k] = self._eval(*self._canonical(wi[k], wo[k]))
        return out

    def pdf(self, wi: Array, wo: Array) -> Array:
        """Density of `sample` in solid angle, (N,)."""
        wi, wo = directions(wi), directions(wo)
        out = np.zeros(len(wi))
        above = np.flatnonzero((wi[:, 2] > 0) & (wo[:, 2] > 0))
        for at in range(0, len(above), CHUNK):
            k = above[at : at + CHUNK]
            a, b = self._canonical(wi[k], wo[k])
            corners, phi = self._incidence(a)
            x, y, h = self._half(a, b, phi)
            x = np.maximum(x, POLE)
            s, t, p = self.vndf.invert(x, y, corners)
            out[k] = p * self.luminance.eval(s, t, corners) / _half_jacobian(x, a, h)
        return out

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        """wo (N, 3) and its density (N,), 0 where the draw fell below the horizon."""
        wi, u = np.atleast_2d(np.asarray(wi, float)), np.atleast_2d(np.asarray(u, float))
        a, _ = self._canonical(wi, wi)
        corners, phi = self._incidence(a)
        s, t, p = self.luminance.sample(u[:, 0], u[:, 1], corners)
        x, y, q = self.vndf.sample(s, t, corners)
        theta, azimuth = np.pi / 2 * x * x, np.pi * (2 * y - 1) + (phi if self.isotropic else 0)
        h = np.stack([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)], -1)
        b = reflect(a, h)
        density = p * q / _half_jacobian(x, a, h)
        _, wo = self._canonical(wi, b)  # the mirroring is its own inverse
        ok = (wi[:, 2] > 0) & (wo[:, 2] > 0) & (np.einsum("ni,ni->n", a, h) > 0)
        return wo, np.where(ok, density, 0)

    def _eval(self, wi: Array, wo: Array) -> Array:
        corners, phi = self._incidence(wi)
        x, y, _ = self._half(wi, wo, phi)
        s, t, _ = self.vndf.invert(x, y, corners)
        f = np.maximum(self.colour.eval(s, t, corners), 0)
        scale = 1 / wo[:, 2]
        if self.jacobian:
            one: Corners = [(np.zeros(len(wi), np.int64), np.ones(len(wi)))]
            theta_i, _ = to_angles(wi)
            sigma = self.sigma.eval(np.sqrt(theta_i * 2 / np.pi), (phi + np.pi) / (2 * np.pi), one)[:, 0]
            scale = scale * self.ndf.eval(x, y, one)[:, 0] / (4 * sigma)
        return f * scale[:, None]

    def _canonical(self, wi: Array, wo: Array) -> tuple[Array, Array]:
        """The pair turned or mirrored into the azimuths of the table (half: turned by pi; quarter: mirrored)."""
        if self.reduction < 2:
            return wi, wo
        middle = 0.5 * (self.phi_i[0] + self.phi_i[-1])
        if self.reduction == 2:
            flip = wi[:, 0] * np.cos(middle) + wi[:, 1] * np.sin(middle) < 0
            sign = np.where(flip, -1.0, 1.0)
            signs = np.stack([sign, sign, np.ones(len(wi))], -1)
        else:
            x = np.where(wi[:, 0] * np.cos(middle) < 0, -1.0, 1.0)
            y = np.where(wi[:, 1] * np.sin(middle) < 0, -1.0, 1.0)
            signs = np.stack([x, y, np.ones(len(wi))], -1)
        return wi * signs, wo * signs

    def _incidence(self, wi: Array) -> tuple[Corners, Array]:
        theta_i, phi_i = to_angles(wi)
        turned = phi_i
        if not self.isotropic and self.reduction == 1:  # a full turn may start anywhere; rounding must not wrap
            first = self.phi_i[0] - 1e-6
            turned = first + (phi_i - first) % (2 * np.pi)
        return self.grid.corners(turned, theta_i), phi_i

    def _half(self, wi: Array, wo: Array, phi_i: Array) -> tuple[Array, Array, Array]:
        """The half vector's place in the square, and itself."""
        h = half_vector(wi, wo)
        theta, phi = to_angles(h)
        y = ((phi - phi_i if self.isotropic else phi) + np.pi) / (2 * np.pi)
        return np.sqrt(theta * 2 / np.pi), y - np.floor(y), h


def _half_jacobian(x: Array, wi: Array, h: Array) -> Array:
    """d(square) -> d(wo): 2 pi^2 x sin(theta_m) of the square, 4 (wi.h) of the reflection; kept off 0 at the pole."""
    return np.maximum(2 * np.pi**2 * x * np.sin(np.pi / 2 * x * x), 1e-12) * 4 * np.abs(np.einsum("ni,ni->n", wi, h))


def check_fields(fields: dict[str, Array], name: str) -> str:
    """What holds the colours, 'rgb' or 'spectra'; raises BrdfFileError naming the field that is wrong."""

    def bad(key: str, what: str) -> BrdfFileError:
        return BrdfFileError(f"{name}: field '{key}' {what}")

    colours = "spectra" if "spectra" in fields else "rgb"
    rank = {"theta_i": 1, "phi_i": 1, "ndf": 2, "sigma": 2, "vndf": 4, "luminance": 4, colours: 5, "jacobian": 1}
    if colours == "spectra":
        rank["wavelengths"] = 1
    for key, n in rank.items():
        if key not in fields:
            raise bad(key, "is missing; not an RGL BRDF, or an incomplete one")
        if fields[key].ndim != n or fields[key].size == 0:
            raise bad(key, f"has the shape {fields[key].shape}, {n} axes wanted")
        if key != "jacobian" and fields[key].dtype.kind != "f":
            raise bad(key, f"holds {fields[key].dtype}, floating-point numbers wanted")
        if not np.isfinite(fields[key]).all():
            raise bad(key, "holds NaN or infinity")
    nodes = (fields["phi_i"].size, fields["theta_i"].size)
    for key in ("vndf", "luminance", colours):
        if fields[key].shape[:2] != nodes:
            raise bad(key, f"has {fields[key].shape[:2]} slices, phi_i and theta_i make {nodes}")
    for key in ("ndf", "sigma", "vndf", "luminance", colours):
        if min(fields[key].shape[-2:]) < 2:
            raise bad(key, f"has {fields[key].shape[-2:]} nodes, 2 or more along each side wanted")
        if key in ("ndf", "sigma", "vndf") and fields[key].min() < 0:
            raise bad(key, "holds negative values")
        if np.abs(fields[key]).max() > 1e30:
            raise bad(key, "holds values above 1e30")
    if fields["sigma"].min() <= 0:
        raise bad("sigma", "holds 0")
    channels = fields["wavelengths"].size if colours == "spectra" else 3
    if fields[colours].shape[2] != channels:
        raise bad(colours, f"has {fields[colours].shape[2]} channels, {channels} wanted")
    for key in ("theta_i", "phi_i", "wavelengths"):
        if key in rank and np.any(np.diff(fields[key]) <= 0):
            raise bad(key, "is not ascending")
    if fields["theta_i"].min() < -1e-3 or fields["theta_i"].max() > np.pi / 2 + 1e-3:
        raise bad("theta_i", "lies outside 0..pi/2")
    if np.abs(fields["phi_i"]).max() > 2 * np.pi + 1e-3:
        raise bad("phi_i", "lies outside -2pi..2pi")
    return colours
