"""One epoch of a run that looks for the unknown: what its target is, and with what density it draws.

The target, for the readings f of this epoch, is

    p(wi, wo) ∝ E^beta / M · n,    E = (s(f) + floor) cos(theta_o) M g

s(f) cos(theta_o) is the energy that the referee counts there, as a share of the albedo at that theta_i; M the solid
angle that a volume of the reconstruction's own coordinates stands for; g by how much samples around are missed when
they are left out. So E is the error to be expected per volume, E^beta the density of samples that it deserves; n is
how empty it is around, for that density: what was measured already is left alone (docs/sampling.md: what else was
tried). Of a run for one picture (gonio.picture) E is multiplied by w + its floor and is no share of an albedo: what
counts is the light in the picture. All but s(f) is frozen for the epoch, made of what was measured before without the
points where chains now are (Holden, Hauge & Holden 2009); f enters as measured, so that a draw can be refused for the
reading it led to.

A candidate y of density b is drawn with probability r(y) = min(1, c p^(y) / b(y)), p^ the target with the running
reconstruction for f. What is drawn has the density q = b r / a, a = E_b[r], whatever p^ is worth.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from gonio.geometry import Array, to_angles
from gonio.mcmc.chain.support import NoSupport
from gonio.mcmc.proposals.pool import Pool
from gonio.mcmc.target import Unknown

BANDS = 15  # of theta_i, each with the same energy
FLOOR = 0.05  # share of the energy that is laid evenly: what the reconstruction wrongly holds for black is visited
GRAZING, LIGHTER = np.radians(86.0), 0.3  # the referee does not look beyond
EMPTY, AT_LEAST, AT_MOST = 3, 0.7, 1.3  # n = (hole / usual hole)^EMPTY between these: weights have no long tail
AT_ONCE = 2**21  # values of f, of all channels, worked out at a time
CALIBRATION, USUAL = 8192, 2000  # candidates that c and a, and the usual hole, are found with
TINY = 1e-300


class Running(Protocol):
    """What a plan wants of a running reconstruction: f (N, C); the coordinates (N, d) in which it is smooth; the solid
    angle |dwi dwo| per volume of them (N,); by how much samples around are missed (N,); the peak's width, radians."""

    t0: float
    dimensions: int

    def eval(self, wi: Array, wo: Array) -> Array: ...
    def coordinates(self, wi: Array, wo: Array) -> Array: ...
    def measure(self, wi: Array, wo: Array) -> Array: ...
    def roughness(self, wi: Array, wo: Array) -> Array: ...


@dataclass(frozen=True)
class View:
    """Of N pairs, as the epoch has them: x (N, d) coordinates, log_volume (N,) log of samples deserved per volume,
    log_rest (N,) log of the target but for (s + floor)^beta, log_p (N,) log p^."""

    x: Array
    log_volume: Array
    log_rest: Array
    log_p: Array


class Epoch:
    """The frozen part of the target (`Unknown.epoch`) and the density of draws from it.

    measured: wi, wo (N, 3) of what the epoch knows; support(wi, wo) -> (N,) bool, what the rig reaches. asked: log (w +
    floor) of pairs, (N,), of a run for one picture.
    """

    def __init__(
        self,
        running: Running,
        target: Unknown,
        measured: tuple[Array, Array],
        support: Callable,
        rng: np.random.Generator,
        asked: Callable[[Array, Array], Array] | None = None,
    ):
        from scipy.spatial import cKDTree

        self.running, self.target, self.support, self.asked = running, target, support, asked
        self.pool = Pool(0.25 * running.t0)
        self.occupied = running.coordinates(*measured)
        self._tree = cKDTree(self.occupied)
        self._usual = 1.0
        wi, wo = self.candidates(CALIBRATION, rng)
        if len(wi) == 0:
            raise NoSupport("no pair of directions can be measured; check the rig's limits and stay-out cone")
        log_b = self.pool.log_prob(wi, wo)
        self._inverse_albedo, self._inverse_even = self._bands(wi, wo, log_b)
        self._usual = self._usual_hole(wi, wo, log_b, rng)
        self._log_ratio = self.view(wi, wo).log_p - log_b
        self._log_c, self.log_a = -np.inf, -np.inf

    def candidates(self, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Those of `count` candidates that the rig can measure."""
        wi, wo = self.pool.candidates(count, rng)
        keep = self.support(wi, wo)
        return wi[keep], wo[keep]

    def _bands(self, wi: Array, wo: Array, log_b: Array) -> tuple[Array, Array]:
        """By band of theta_i: the inverse of every channel's energy (BANDS, C), and of that of f = 1, (BANDS,)."""
        weight, band = np.exp(-log_b) * wo[:, 2], self._band(wi)
        f = np.maximum(self.running.eval(wi, wo), 0)
        scale = max(float(f.max(initial=0.0)), TINY)
        f = f / scale
        bands = BANDS if self.asked is None else 1
        even = np.maximum(np.bincount(band, weight, bands), TINY)
        bright = np.stack([np.bincount(band, weight * of_channel, bands) for of_channel in f.T], 1)
        # a channel that is nearly dead, or dark in a band, is not blown up beyond a thousandth of the brightest
        usual = (bright.sum(0) / even.sum()).max()
        return 1 / np.maximum(bright, 1e-3 * max(usual, TINY) * even[:, None]) / scale, 1 / even

    def _usual_hole(self, wi: Array, wo: Array, log_b: Array, rng: np.random.Generator) -> float:
        v = self.view(wi, wo)
        log_r = v.log_volume - np.log(self.running.measure(wi, wo) + TINY) - log_b
        r = np.exp(log_r - log_r.max())
        some = rng.choice(len(wi), USUAL, p=r / r.sum())
        return max(float(np.median(self._holes(v.x[some], v.log_volume[some]))), TINY)

    def _holes(self, x: Array, log_volume: Array) -> Array:
        """Distance to the nearest measured, for the spacing that is wanted there, (N,); 1 where nothing was."""
        if len(self.occupied) == 0:
            return np.ones(len(x))
        return np.exp(log_volume / self.running.dimensions) * self._tree.query(x)[0]

    # ---- the target

    def _band(self, wi: Array):
        """Which band of theta_i, (N,); of a run for a picture all are one: it says itself how much each counts."""
        return band_of(wi) if self.asked is None else np.zeros(len(wi), int)

    def inverse_albedo(self, wi: Array) -> Array:
        """(N, C): with it, every band of theta_i has the same energy."""
        return self._inverse_albedo[self._band(wi)]

    def floor(self, wi: Array) -> Array:
        """(N,), in units of s: FLOOR of a band's energy."""
        return FLOOR / (1 - FLOOR) * self._inverse_even[self._band(wi)]

    def view(self, wi: Array, wo: Array) -> View:
        """In parts that fit into memory, however many channels there are."""
        rows = max(1024, AT_ONCE // max(self._inverse_albedo.shape[1], 1))
        if len(wi) <= rows:
            return self._view(wi, wo)
        parts = [self._view(wi[k : k + rows], wo[k : k + rows]) for k in range(0, len(wi), rows)]
        return View(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(View)))

    def _view(self, wi: Array, wo: Array) -> View:
        x, m = self.running.coordinates(wi, wo), np.log(self.running.measure(wi, wo) + TINY)
        v = np.where(to_angles(wi)[0] > GRAZING, np.log(LIGHTER), 0.0) if self.asked is None else self.asked(wi, wo)
        rest = self.target.power * (np.log(wo[:, 2]) + v + m + np.log(self.running.roughness(wi, wo)))
        expected = self.target.log_strength(self.running.eval(wi, wo), self.inverse_albedo(wi), self.floor(wi))
        hole = np.clip(self._holes(x, rest + expected) / self._usual, AT_LEAST, AT_MOST)
        log_rest = rest - m + EMPTY * np.log(hole)
        return View(x, rest + expected, log_rest, log_rest + expected)

    def log_rest(self, wi: Array, wo: Array) -> Array:
        """log of all of the target but (s + floor)^beta, (N,)."""
        return self.view(wi, wo).log_rest

    # ---- the draws

    def expect(self, count: float, pool: int) -> None:
        """Let `pool` candidates of the cube give about `count` draws, by the choice of c; at most all of them. How many
        they were gives a."""
        share = min(count / pool, 0.9 * len(self._log_ratio) / CALIBRATION)
        low, high = -self._log_ratio.max() - 40, -self._log_ratio.min() + 1
        for _ in range(60):
            middle = 0.5 * (low + high)
            drawn = np.exp(np.minimum(0.0, self._log_ratio + middle)).sum() / CALIBRATION
            low, high = (middle, high) if drawn < share else (low, middle)
        self._log_c = middle

    def log_drawn(self, log_p: Array, log_b: Array) -> Array:
        """log r of candidates, (N,)."""
        return np.minimum(0.0, log_p - log_b + self._log_c)

    def log_prob(self, wi: Array, wo: Array) -> Array:
        """log q of draws, (N,), solid angles."""
        log_b = self.pool.log_prob(wi, wo)
        return log_b + self.log_drawn(self.view(wi, wo).log_p, log_b) - self.log_a

    # ---- what a sampler asks of a proposal whose coordinates are the directions

    def from_directions(self, wi: Array, wo: Array) -> Array:
        return np.concatenate([wi.T, wo.T])

    def log_jacobian(self, u: Array) -> Array:
        return -self.log_prob(u[:3].T, u[3:].T)


def band_of(wi: Array):
    return np.minimum((to_angles(wi)[0] * (BANDS / (np.pi / 2))).astype(int), BANDS - 1)
