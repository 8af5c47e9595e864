"""Coordinates in which a flow works: unit cubes of pairs (wi, wo).

Three coordinates for an isotropic surface, whose pairs may be turned about the normal and mirrored: the azimuth of wi
is 0 and the pair lies on one side of the plane of incidence; four for an anisotropic one. Each cube offers

    dimensions, leading, periodic   for the flow's masks
    to_directions(x)   -> wi, wo    x (N, D) in [0, 1], directions (N, 3); wo may fall below the horizon
    from_directions(wi, wo) -> x    its inverse, up to turning and mirroring if isotropic
    log_jacobian(x, wi, wo)         log |d(wi, wo) / d(x, azimuth of wi)|, the azimuth only if isotropic

`half` is the default; docs/flow.md has what each was worth.
"""

from typing import Protocol

import numpy as np

from gonio.brdf.models.ndf import GgxNdf
from gonio.geometry import Array, from_half_diff, half_vector, reflect, to_half_diff, unit

PI = np.pi
TINY = 1e-300
FINEST = 1e-3  # of tan(theta_h / 2) * 2 in `half`: a peak narrower than 0.06 degrees is flat to it


class Cube(Protocol):
    """See the module's text; `coordinates` is its name in `make_cube`."""

    coordinates: str
    dimensions: int
    leading: tuple[int, ...]
    periodic: tuple[int, ...]

    def to_directions(self, x: Array) -> tuple[Array, Array]: ...

    def from_directions(self, wi: Array, wo: Array) -> Array: ...

    def log_jacobian(self, x: Array, wi: Array, wo: Array) -> Array: ...


class RawCube:
    """The thesis's (3.5): theta_h = x0 pi/2, theta_d = x1 pi/2, phi_d = x2 pi; else 2 pi x2, phi_h = 2 pi x3."""

    coordinates = "raw"

    def __init__(self, anisotropic: bool = False):
        self.dimensions = 4 if anisotropic else 3
        self.leading: tuple[int, ...] = ()
        self.periodic: tuple[int, ...] = (2, 3) if anisotropic else ()

    def polar(self, x: Array) -> tuple[Array, Array]:
        """theta_h and theta_d."""
        return 0.5 * PI * x[:, 0], 0.5 * PI * x[:, 1]

    def unpolar(self, theta_h: Array, theta_d: Array) -> tuple[Array, Array]:
        return theta_h / (0.5 * PI), theta_d / (0.5 * PI)

    def to_directions(self, x: Array) -> tuple[Array, Array]:
        theta_h, theta_d = self.polar(x)
        if self.dimensions == 4:
            return from_half_diff(theta_h, 2 * PI * x[:, 3], theta_d, 2 * PI * x[:, 2])
        return from_half_diff(theta_h, np.zeros(len(x)), theta_d, PI * x[:, 2])

    def from_directions(self, wi: Array, wo: Array) -> Array:
        theta_h, phi_h, theta_d, phi_d = to_half_diff(wi, wo)
        polar = self.unpolar(theta_h, theta_d)
        if self.dimensions == 4:
            return np.stack([*polar, phi_d / (2 * PI) % 1, phi_h / (2 * PI) % 1], 1)
        return np.stack([*polar, np.abs(phi_d) / PI], 1)

    def log_jacobian(self, x: Array, wi: Array, wo: Array) -> Array:
        # dwi dwo = 4 cos theta_d sin theta_d sin theta_h dtheta_d dphi_d dtheta_h dphi_h
        theta_h, theta_d = self.polar(x)
        azimuths = 4 * PI * PI if self.dimensions == 4 else PI
        return np.log(2 * np.abs(np.sin(2 * theta_d)) * np.sin(theta_h) * 0.25 * PI * PI * azimuths + TINY)


class FlatCube(RawCube):
    """(1 - cos theta_h, sin^2 theta_d, phi_d): the measure dwi dwo is constant."""

    coordinates = "flat"

    def polar(self, x: Array) -> tuple[Array, Array]:
        return 2 * np.arctan2(np.sqrt(x[:, 0]), np.sqrt(2 - x[:, 0])), np.arctan2(
            np.sqrt(x[:, 1]), np.sqrt(1 - x[:, 1])
        )

    def unpolar(self, theta_h: Array, theta_d: Array) -> tuple[Array, Array]:
        return 2 * np.sin(0.5 * theta_h) ** 2, np.sin(theta_d) ** 2

    def log_jacobian(self, x: Array, wi: Array, wo: Array) -> Array:
        return np.full(len(x), np.log(2 * (4 * PI * PI if self.dimensions == 4 else PI)))


class _AboutIncidence:
    """x2 = 1 - cos theta_i leads, so that the flow knows p(wo | wi); anisotropic: the azimuth 2 pi x3 before it."""

    def __init__(self, anisotropic: bool = False):
        self.anisotropic = anisotropic
        self.dimensions = 4 if anisotropic else 3
        self.leading: tuple[int, ...] = (3, 2) if anisotropic else (2,)
        self.periodic: tuple[int, ...] = (1, 3) if anisotropic else ()

    def _incidence(self, x: Array) -> Array:
        r, phi = np.sqrt(x[:, 2] * (2 - x[:, 2])), 2 * PI * x[:, 3] if self.anisotropic else np.zeros(len(x))
        return np.stack([r * np.cos(phi), r * np.sin(phi), 1 - x[:, 2]], -1)

    def _leading(self, wi: Array) -> list[Array]:
        z = (wi[:, 0] ** 2 + wi[:, 1] ** 2) / (1 + wi[:, 2])  # 1 - cos theta_i without the cancellation
        return [z, np.arctan2(wi[:, 1], wi[:, 0]) / (2 * PI) % 1] if self.anisotropic else [z]


class VndfCube(_AboutIncidence):
    """GGX normals visible from wi, by spherical caps (Dupuy & Benyoub 2023): x0 the cap's height, x1 its azimuth.

    Over mirrored halves (azimuth in [0, pi]) if isotropic. log density of wo given wi: D_wi(h) / (4 wo.h).
    """

    coordinates = "vndf"

    def __init__(self, alpha: float, anisotropic: bool = False):
        super().__init__(anisotropic)
        self.alpha, self.ndf = alpha, GgxNdf(alpha, alpha)

    def to_directions(self, x: Array) -> tuple[Array, Array]:
        wi = self._incidence(x)
        turn = x[:, 1] if self.anisotropic else 0.5 * x[:, 1]
        h = self.ndf.sample(wi, np.stack([x[:, 0], turn], 1))
        return wi, reflect(wi, h)

    def from_directions(self, wi: Array, wo: Array) -> Array:
        lead = self._leading(wi)
        if not self.anisotropic:
            wi, wo = _to_plane(wi, wo)
        scale = np.array([self.alpha, self.alpha, 1.0])
        v, m = unit(wi * scale), unit(half_vector(wi, wo) / scale)
        cap = reflect(v, m)
        down = (cap[:, 0] ** 2 + cap[:, 1] ** 2) / (1 + np.maximum(cap[:, 2], 0))
        height = np.where(cap[:, 2] > 0, down, 1 - cap[:, 2])
        turn = np.arctan2(cap[:, 1], cap[:, 0])
        turn = turn / (2 * PI) % 1 if self.anisotropic else np.abs(turn) / PI
        return np.stack([np.clip(height / (1 + v[:, 2]), 0, 1), turn, *lead], 1)

    def log_jacobian(self, x: Array, wi: Array, wo: Array) -> Array:
        h = half_vector(wi, wo)
        # D G1 / (4 cos theta_i), as gonio.mcmc.proposals.ggx_density has it: no division by a cosine near 0
        slope = (h[:, 0] ** 2 + h[:, 1] ** 2) / self.alpha**2 + h[:, 2] ** 2
        stretched = np.sqrt((wi[:, 0] ** 2 + wi[:, 1] ** 2) * self.alpha**2 + wi[:, 2] ** 2)
        log_pdf = -np.log(4 * PI * self.alpha**2) - 2 * np.log(slope) + np.log(2 / (wi[:, 2] + stretched))
        return (np.log(2 * PI) if self.anisotropic else np.log(0.5)) - log_pdf


class HalfCube(_AboutIncidence):
    """h in polar coordinates about the normal: log-spaced theta_h up to the horizon of wo, so no point lies below it.

    With t = 2 tan(theta_h / 2), x0 = log(1 + t^2/a^2) / log(1 + t_m^2/a^2): the cumulative of an even mixture of lobes
    of all widths from a on, so that a mirror's peak and a wall's fill the same share of the axis. t_m is where wo
    meets the horizon: cos theta_o > 0 iff 2 theta_h - delta < pi/2, delta = atan2(cos phi sin theta_i, cos theta_i),
    phi = pi x1 the azimuth of h from that of wi (2 pi x1 if anisotropic).
    """

    coordinates = "half"

    def to_directions(self, x: Array) -> tuple[Array, Array]:
        wi = self._incidence(x)
        turn = (2 * PI if self.anisotropic else PI) * x[:, 1]
        t2 = FINEST**2 * np.expm1(x[:, 0] * self._log_reach(wi[:, 2], turn))
        sin_h, cos_h = np.sqrt(t2) / (1 + 0.25 * t2), (1 - 0.25 * t2) / (1 + 0.25 * t2)
        azimuth = turn + (2 * PI * x[:, 3] if self.anisotropic else 0.0)
        h = np.stack([sin_h * np.cos(azimuth), sin_h * np.sin(azimuth), cos_h], -1)
        wo = reflect(wi, h)
        # the outermost face is the horizon itself: rounding must not put it below
        wo[:, 2] = np.maximum(wo[:, 2], 1e-12)
        return wi, wo

    def from_directions(self, wi: Array, wo: Array) -> Array:
        h = half_vector(wi, wo)
        lead = self._leading(wi)
        turn = np.arctan2(wi[:, 0] * h[:, 1] - wi[:, 1] * h[:, 0], wi[:, 0] * h[:, 0] + wi[:, 1] * h[:, 1])
        t2 = 4 * (h[:, 0] ** 2 + h[:, 1] ** 2) / (1 + h[:, 2]) ** 2
        turn = turn / (2 * PI) % 1 * 2 * PI if self.anisotropic else np.abs(turn)
        x0 = np.log1p(t2 / FINEST**2) / self._log_reach(wi[:, 2], turn)
        return np.stack([np.clip(x0, 0, 1), turn / (2 * PI if self.anisotropic else PI), *lead], 1)

    def log_jacobian(self, x: Array, wi: Array, wo: Array) -> Array:
        h = half_vector(wi, wo)
        turn = (2 * PI if self.anisotropic else PI) * x[:, 1]
        reach = self._log_reach(wi[:, 2], turn)
        t2 = FINEST**2 * np.expm1(x[:, 0] * reach)
        polar = reach * 0.5 * (FINEST**2 + t2) / (1 + 0.25 * t2) ** 2  # sin theta_h dtheta_h / dx0
        cos_d = np.maximum(np.einsum("ni,ni->n", wi, h), TINY)
        azimuths = 4 * PI * PI if self.anisotropic else PI
        return np.log(4 * cos_d * polar * azimuths)

    def _log_reach(self, cos_i: Array, turn: Array) -> Array:
        """log(1 + t_m^2/a^2) at the horizon of wo."""
        delta = np.arctan2(np.cos(turn) * np.sqrt((1 - cos_i) * (1 + cos_i)), cos_i)
        return np.log1p((2 * np.tan(0.25 * (0.5 * PI + delta))) ** 2 / FINEST**2)


def _to_plane(wi: Array, wo: Array) -> tuple[Array, Array]:
    """The pair turned about the normal until wi has azimuth 0."""
    r = np.hypot(wi[:, 0], wi[:, 1])
    c, s = (
        np.where(r > 0, wi[:, 0], 1.0) / np.where(r > 0, r, 1),
        np.where(r > 0, wi[:, 1], 0.0) / np.where(r > 0, r, 1),
    )
    x, y = c * wo[:, 0] + s * wo[:, 1], c * wo[:, 1] - s * wo[:, 0]
    return np.stack([r, np.zeros_like(r), wi[:, 2]], 1), np.stack([x, y, wo[:, 2]], 1)


def make_cube(coordinates: str, alpha: float, anisotropic: bool = False) -> Cube:
    """`raw`, `flat`, `vndf` (of roughness alpha) or `half`. Raises KeyError."""
    if coordinates == "vndf":
        return VndfCube(alpha, anisotropic)
    cubes: dict[str, type[RawCube] | type[HalfCube]] = {"raw": RawCube, "flat": FlatCube, "half": HalfCube}
    return cubes[coordinates](anisotropic)
