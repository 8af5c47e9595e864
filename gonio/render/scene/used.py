"""How much of a material a picture uses, and what it saves to measure only that."""

from dataclasses import dataclass

import numpy as np

import gonio
from gonio.brdf.library import find
from gonio.geometry import Array, from_angles, from_half_diff, half_diff_jacobian, to_angles
from gonio.picture import Picture

MOST = 0.95  # of the light off the material
DRAWS = 2**16
PEAK = 0.02  # draws are close together at the peak: theta_h = PEAK sinh(u)


@dataclass(frozen=True)
class Used:
    """theta_i, theta_o (2,): within which MOST of the light arrives and leaves, degrees; domain: the share of all
    pairs, by solid angle and cosine, that brings it; fewer: how many times fewer measurements the picture needs."""

    theta_i: Array
    theta_o: Array
    domain: float
    fewer: float
    material: str

    @property
    def lines(self) -> list[str]:
        (a, b), (c, d) = self.theta_i, self.theta_o
        return [
            f"light    {MOST:.0%} arrives at {a:.0f} to {b:.0f} degrees and leaves at {c:.0f} to {d:.0f}",
            f"domain   {self.domain:.0%} of all pairs of directions bring {MOST:.0%} of it",
            f"rig time about 1 : {self.fewer:.1f} of that for every direction, to the same error ({self.material})",
        ]


def used(picture: Picture, material: str) -> Used:
    """Raises ConfigError where the material is not known."""
    brdf = gonio.load_brdf(find(material).path)
    wi, wo, volume = _pairs()
    w = picture(wi, wo)
    light = w * wo[:, 2] * volume
    order = np.argsort(-w)
    most = order[: int(np.searchsorted(np.cumsum(light[order]), MOST * light.sum())) + 1]
    cosine = wo[:, 2] * volume
    f = brdf.eval(wi, wo)
    ends = [(1 - MOST) / 2, (1 + MOST) / 2]
    arrives, leaves = (np.degrees(np.quantile(to_angles(v)[0], ends)) for v in (picture.wi, picture.wo))
    domain = float(cosine[most].sum() / cosine.sum())
    ratio = fewer((f * w[:, None]).mean(1) * wo[:, 2] * volume, f.mean(1) * wo[:, 2] * volume)
    return Used(arrives, leaves, domain, ratio, material)


def fewer(seen: Array, every: Array) -> float:
    """Measurements for all directions over those for the picture, to one relative error.

    seen, every (N,): the light per volume of coordinates stretched at the peak, as the reconstruction's are. Where n
    are measured per volume the local relative error is n^-a, a about 1/2 (error falls as N^-1/2). The light that is
    wrong is the integral of weight n^-a, least for n ∝ weight^(1/(1+a)), and then (integral of weight^(1/(1+a)))^(1+a)
    N^-a: N ∝ (that over the integral of weight)^(1/a).
    """
    a = 0.5
    every_one, of_picture = (
        (float(np.mean(weight ** (1 / (1 + a)))) ** (1 + a) / max(float(np.mean(weight)), 1e-300)) ** (1 / a)
        for weight in (every, seen)
    )
    return float(every_one / max(of_picture, 1e-300))


def _pairs() -> tuple[Array, Array, Array]:
    """wi, wo (N, 3) even in (asinh(theta_h / PEAK), theta_d, phi_d), and the solid angles each stands for."""
    from scipy.stats import qmc

    u = qmc.Sobol(3, seed=0).random(DRAWS)
    top = np.arcsinh(np.pi / 2 / PEAK)
    theta_h, theta_d = PEAK * np.sinh(top * u[:, 0]), np.pi / 2 * u[:, 1]
    wi, wo = from_half_diff(theta_h, 0 * theta_h, theta_d, 2 * np.pi * u[:, 2])
    volume = half_diff_jacobian(theta_d) * np.sin(theta_d) * np.sin(theta_h) * np.cosh(top * u[:, 0])
    up = (wi[:, 2] > 1e-3) & (wo[:, 2] > 1e-3)
    return wi[up], wo[up], volume[up]


def slices(picture: Picture) -> tuple[Array, Array]:
    """w cos theta_o over (theta_i, theta_o), mean over phi, and over (theta_o, phi), mean over theta_i: (N, N) each."""
    n = 72
    theta = (np.arange(n) + 0.5) / n * np.pi / 2
    phi = (np.arange(n) + 0.5) / n * np.pi
    i, o, p = (q.ravel() for q in np.meshgrid(theta, theta, phi, indexing="ij"))
    w = (picture(from_angles(i, 0 * i), from_angles(o, p)) * np.cos(o)).reshape(n, n, n)
    return w.mean(2), (w * np.sin(theta)[:, None, None]).mean(0)
