"""Candidates for a block: pairs even in the logarithm of theta_h and in the other angles of half and difference.

    theta_h = t sinh(u L), L = asinh(pi / 2 t),   theta_d = pi/2 u,   phi_d = 2 pi u,   phi_h = 2 pi u

so that a peak of width t has its share of them and a broad lobe too. Quasi-random numbers shifted at random (Cranley &
Patterson 1976): each candidate alone follows the density exactly, together they are spread evenly.
"""

import numpy as np

from gonio.geometry import Array, from_half_diff

LOWEST = 0.005  # cos(theta) below which nothing is asked: the last third of a degree above the horizon
NARROWEST, WIDEST = 2e-3, 0.5  # t, radians
BASES = (2, 3, 5, 7)
TINY = 1e-300


def evenly(count: int) -> Array:
    """(count, 4) in the unit cube: Halton's sequence (1960), even in any number of its first points."""
    return np.stack([_radical_inverse(np.arange(1, count + 1), b) for b in BASES], 1)


def _radical_inverse(n: Array, base: int) -> Array:
    """The digits of n (N,) mirrored at the point."""
    out, weight, n = np.zeros(len(n)), 1.0, n.copy()
    while n.any():
        n, digit = np.divmod(n, base)
        weight /= base
        out += weight * digit
    return out


class Pool:
    """Pairs (wi, wo) of known density for peaks of width t (radians)."""

    def __init__(self, t: float):
        self.t = float(np.clip(t, NARROWEST, WIDEST))
        self.length = float(np.arcsinh(np.pi / 2 / self.t))

    def candidates(self, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """wi, wo (N, 3), both above the lowest elevation: what is left of `count`."""
        u = (evenly(count) + rng.random(4)) % 1
        theta_h = self.t * np.sinh(u[:, 0] * self.length)
        wi, wo = from_half_diff(theta_h, 2 * np.pi * u[:, 3], np.pi / 2 * u[:, 1], 2 * np.pi * u[:, 2])
        keep = (wi[:, 2] > LOWEST) & (wo[:, 2] > LOWEST)
        return wi[keep], wo[keep]

    def log_prob(self, wi: Array, wo: Array) -> Array:
        """log density (N,), solid angles of wi and wo; of the whole cube, the part that is too low in it.

        |dwi dwo| = 4 cos(theta_d) sin(theta_h) sin(theta_d) dtheta_h dphi_h dtheta_d dphi_d (METHOD 2).
        """
        s, t = wi + wo, wi - wo
        across, upright = np.hypot(s[:, 0], s[:, 1]), s[:, 2]
        theta_h = np.arctan2(across, upright)
        # |s| = 2 cos(theta_d), |t| = 2 sin(theta_d): their product is 2 sin(2 theta_d), without an angle
        cosine, sine = 0.5 * np.sqrt((s * s).sum(1)), 0.5 * np.sqrt((t * t).sum(1))
        sine_h = across / np.maximum(2 * cosine, TINY)
        solid = 4 * cosine * sine * sine_h * np.hypot(self.t, theta_h)
        return -np.log(np.maximum(solid, TINY)) - np.log(self.length * np.pi / 2 * 4 * np.pi**2)
