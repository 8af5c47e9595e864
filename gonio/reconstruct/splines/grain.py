"""The frame of an anisotropic sample: brushed metal, silk. Four angles, half vectors squeezed to a round peak.

With slopes (x, y) = h_xy / h_z turned by psi into the sample's grain, x' = x / q and y' = y q make an elliptic peak of
roughnesses alpha_x / alpha_y = q^2 a round one: theta_h, phi_h below are those of (x', y', 1). The second azimuth is
that of wi - wo, which means something at theta_h = 0 too, where phi_d does not.
"""

from dataclasses import dataclass, fields

import numpy as np

from gonio.geometry import Array, unit
from gonio.reconstruct.splines.isotropic import elevation, radius, theta_d_of, theta_h_of
from gonio.reconstruct.splines.stretch import grazing, ratio, solid_angle
from gonio.reconstruct.tables.lookup import nodes


@dataclass(frozen=True)
class GrainAngles:
    """Of N pairs: squeezed half vector, theta_d, azimuth of wi - wo, cosines with the normal; (N,) each."""

    theta_h: Array
    phi_h: Array
    theta_d: Array
    phi_t: Array
    cos_i: Array
    cos_o: Array

    def at(self, index) -> "GrainAngles":
        """Those at `index`."""
        return GrainAngles(*(getattr(self, k.name)[index] for k in fields(self)))


@dataclass(frozen=True)
class Grain:
    """psi: the grain's direction, radians from the sample's x axis; q: root of the ratio of roughnesses, >= 1."""

    psi: float
    q: float

    @classmethod
    def of(cls, wi: Array, wo: Array, f: Array) -> "Grain":
        """By the second moments of the slopes of the brightest half vectors, an ellipse like the peak's."""
        h = unit(wi + wo)
        slope = h[:, :2] / np.maximum(h[:, 2:], 0.05)
        # bright among their like: grazing pairs would outshine all others
        bright = np.zeros(len(f), bool)
        value = (f / np.maximum(f.mean(0), 1e-300)).sum(1)
        lower = np.minimum(wi[:, 2], wo[:, 2])
        order = np.argsort(lower)
        for part in np.array_split(order, 5)[1:]:
            bright[part[np.argsort(-value[part])[: max(4, len(part) // 8)]]] = True
        chosen = slope[bright]
        moments = chosen.T @ chosen / len(chosen)
        width, axis = np.linalg.eigh(moments)
        q = float(np.clip((width[1] / max(width[0], 1e-12)) ** 0.25, 1, 6))
        return cls(float(np.arctan2(axis[1, 1], axis[0, 1])), q)

    def angles(self, wi: Array, wo: Array) -> GrainAngles:
        s, t = wi + wo, wi - wo
        length_s, length_t = np.linalg.norm(s, axis=1), np.linalg.norm(t, axis=1)
        c, d = np.cos(self.psi), np.sin(self.psi)
        x, y = (c * s[:, 0] + d * s[:, 1]) / self.q, (c * s[:, 1] - d * s[:, 0]) * self.q
        return GrainAngles(
            np.arctan2(np.hypot(x, y), s[:, 2]),
            np.arctan2(y, x),
            np.arctan2(length_t, length_s),
            np.arctan2(c * t[:, 1] - d * t[:, 0], c * t[:, 0] + d * t[:, 1]),
            np.maximum(wi[:, 2], 1e-6),
            np.maximum(wo[:, 2], 1e-6),
        )

    def stretch(self, t0: float, azimuth: float = 0.7, elevation: float = 0.55) -> "GrainStretch":
        return GrainStretch(t0, azimuth, elevation)

    def chart(self, t0: float) -> "GrainChart":
        return GrainChart(t0, self)

    def to_arrays(self) -> dict[str, Array]:
        return {"grain": np.array([self.psi, self.q])}


@dataclass(frozen=True)
class GrainStretch:
    """In which the residual is smooth, as `stretch.Stretch`: two of the half vector, three of d, the ratio."""

    t0: float
    azimuth: float = 0.7
    elevation: float = 0.55
    dimensions = 4

    def __call__(self, a: GrainAngles) -> Array:
        """(N, 6)."""
        xi = np.arcsinh(a.theta_h / self.t0)
        s = self.azimuth * np.sin(a.theta_d)
        sheet = [s * np.cos(a.phi_t), s * np.sin(a.phi_t), self.elevation * grazing(a.theta_d)]
        return np.stack([xi * np.cos(a.phi_h), xi * np.sin(a.phi_h), *sheet, ratio(a.cos_i, a.cos_o)], 1)

    def measure(self, a: GrainAngles) -> Array:
        """|dwi dwo| per volume of the first five coordinates, (N,), up to a factor."""
        xi = np.maximum(np.arcsinh(a.theta_h / self.t0), 1e-9)
        around = np.sin(a.theta_h) * np.hypot(self.t0, a.theta_h) / xi
        return around * solid_angle(a.theta_d, self.azimuth, self.elevation)


@dataclass(frozen=True)
class GrainChart:
    """(theta_h, phi_h, theta_d, phi_t) <-> [0, 1]^4."""

    t0: float
    grain: Grain
    periodic = (False, True, False, True)
    coarse, refine = (32, 24, 24, 32), (2, 1, 2, 1)
    spread = (16, 8, 12, 8)

    def __call__(self, a: GrainAngles) -> Array:
        turn = lambda phi: np.mod(phi / (2 * np.pi), 1)
        return np.stack([radius(a.theta_h, self.t0), turn(a.phi_h), elevation(a.theta_d), turn(a.phi_t)], 1)

    def nodes(self, n: tuple[int, ...]) -> tuple[GrainAngles, Array]:
        """Angles of all nodes, row by row, and the cosine of the lower direction with the normal."""
        u, p, v, w = (q.ravel() for q in np.meshgrid(*map(nodes, n, self.periodic), indexing="ij"))
        theta_h, phi_h, theta_d, phi_t = theta_h_of(u, self.t0), 2 * np.pi * p, theta_d_of(v), 2 * np.pi * w
        across = np.sin(theta_h)
        q = self.grain.q
        h = unit(np.stack([across * np.cos(phi_h) * q, across * np.sin(phi_h) / q, np.cos(theta_h)], 1))
        level = np.stack([np.cos(phi_t), np.sin(phi_t)], 1)
        tilt = -(h[:, :2] * level).sum(1)
        # wi - wo at a right angle to h, over this azimuth
        t_z = tilt / np.sqrt(h[:, 2] ** 2 + tilt**2)
        cos_i = np.cos(theta_d) * h[:, 2] + np.sin(theta_d) * t_z
        cos_o = np.cos(theta_d) * h[:, 2] - np.sin(theta_d) * t_z
        a = GrainAngles(theta_h, phi_h, theta_d, phi_t, np.maximum(cos_i, 1e-6), np.maximum(cos_o, 1e-6))
        return a, np.minimum(cos_i, cos_o)
