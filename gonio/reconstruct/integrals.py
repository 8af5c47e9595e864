"""Albedos by all that was drawn with a known density: unbiased, whatever the reconstruction is worth.

For a band B of theta_i, rho_B = integral over wi in B, over wo, of f cos(theta_o), divided by the solid angle of B. Of
the draws of one block, of density q_t,

    rho_t = [ integral f^_t + mean over the draws of (f - f^_t) cos(theta_o) 1_B / q_t ] / |B|

is unbiased if f^_t was made of what was measured before the block (a control variate, Owen 2013, ch. 8.9): where the
reconstruction is right, nothing is left to vary. Blocks are put together with weights that were known before they were
measured (draws over the square of f^_t's held-out error), so that the sum stays unbiased: a martingale. Weights over
all densities at once (the deterministic mixture of Veach & Guibas 1995) vary less for draws of fixed densities; these
densities were chosen by the readings, and the sum would be biased.

Draws of a block keep away from each other, so that the variance of each is seen against its neighbours (Grafstroem &
Schelin 2014, How to select representative samples, Scand. J. Stat. 41).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from gonio.geometry import Array, to_angles
from gonio.mcmc.proposals.pool import Pool
from gonio.reconstruct.errors import ReconstructionError
from gonio.reconstruct.running import RunningBrdf, fit
from gonio.reconstruct.samples import Samples

BANDS = 9  # of theta_i, each as wide in angle
EDGES = np.linspace(0, np.pi / 2, BANDS + 1)
SOLID_ANGLES = 2 * np.pi * -np.diff(np.cos(EDGES))
NEIGHBOURS = 4  # draws, itself among them, that a draw is seen against
FEWEST, FEWEST_IN_BAND = 20, 5  # draws of a block, and in a band, that say what they vary by
ABOVE = 1.5  # times the brightest reading
LEAST = 0.01  # share of the weight below which a block is not worth its control
CONTROL, SCRAMBLES = 2**15, 8  # points, of each of so many randomisations, of the integral of f^


@dataclass(frozen=True)
class Draws:
    """What was drawn, by block: block (N,), row (N,) of the sample it led to, -1 where nothing could be measured (the
    control stands for it), wi, wo (N, 3) as asked, log_q (N,) solid angles."""

    block: NDArray[np.int64]
    row: NDArray[np.int64]
    wi: Array
    wo: Array
    log_q: Array


@dataclass(frozen=True)
class Albedo:
    """Directional-hemispherical reflectance by band of theta_i: value, error (BANDS, C), its standard error, infinite
    where hardly anything was drawn; white (2, C), reflectance under even light and its error; draws that made it."""

    value: Array
    error: Array
    white: Array
    draws: int


def albedo(samples: Samples, draws: Draws, *, anisotropic: bool = False) -> Albedo | None:
    """From samples in the order measured and the draws among them; None where no block has draws enough."""
    made = (_Block.of(samples, draws, draws.block == b, anisotropic) for b in np.unique(draws.block))
    blocks = [b for b in made if b is not None]
    if not blocks:
        return None
    weight = np.array([b.weight for b in blocks])
    used = weight >= LEAST * weight.sum()
    weight = weight[used] / weight[used].sum()
    found = [b.estimate() for b, u in zip(blocks, used) if u]
    value = sum(w * v for w, (v, _) in zip(weight, found))
    error = np.sqrt(sum(w**2 * v for w, (_, v) in zip(weight, found)))
    in_band = sum((_integrands(b.wi)[:, :BANDS] > 0).sum(0) for b, u in zip(blocks, used) if u)
    error[:BANDS][in_band < FEWEST_IN_BAND] = np.inf
    return Albedo(value[:BANDS], error[:BANDS], np.stack([value[BANDS], error[BANDS]]), len(draws.row))


@dataclass(frozen=True)
class _Block:
    """wi, wo, log_q of its draws, residual (N, C) of f against the control, None where there was none before it."""

    wi: Array
    wo: Array
    log_q: Array
    residual: Array
    control: "Control | None"

    @classmethod
    def of(cls, samples: Samples, draws: Draws, mine, anisotropic: bool) -> "_Block | None":
        row, wi, wo = draws.row[mine], draws.wi[mine], draws.wo[mine]
        measured = row >= 0
        if measured.sum() < FEWEST:
            return None
        control = _control(samples[: int(row[measured].min())], anisotropic)
        residual, at = np.zeros((len(row), samples.f.shape[1])), samples[row[measured]]
        residual[measured] = at.f
        if control is not None:
            # the residual where it was measured, put where it was asked for: the arms miss by a little
            residual[measured] -= control.eval(at.wi, at.wo)
        return cls(wi, wo, draws.log_q[mine], residual, control)

    @property
    def weight(self) -> float:
        held_out = 1.0 if self.control is None else max(self.control.held_out, 1e-3)
        return len(self.wi) / held_out**2

    def estimate(self) -> tuple[Array, Array]:
        """Of every integral, and its variance, (BANDS + 1, C) each."""
        each = self.residual * (self.wo[:, 2] * np.exp(-self.log_q) / len(self.wi))[:, None]
        terms = each[:, None] * _integrands(self.wi)[:, :, None]
        if self.control is None:
            return terms.sum(0), _variance(terms, np.concatenate([self.wi, self.wo], 1))
        mean, square = _integral(self.control)
        return terms.sum(0) + mean, _variance(terms, self.control.coordinates(self.wi, self.wo)) + square


class Control:
    """A running reconstruction that is nowhere far above what was measured: one spike between samples, harmless to a
    chain, would be most of an integral's variance."""

    def __init__(self, running: RunningBrdf, brightest: Array):
        self.running, self.most = running, ABOVE * brightest
        self.coordinates, self.t0, self.held_out = running.coordinates, running.t0, running.held_out

    def eval(self, wi: Array, wo: Array) -> Array:
        return np.minimum(self.running.eval(wi, wo), self.most)


def _control(samples: Samples, anisotropic: bool) -> Control | None:
    try:
        return Control(fit(samples, anisotropic=anisotropic), np.nanmax(samples.f, 0, initial=0.0))
    except ReconstructionError:
        return None


def _integrands(wi: Array) -> Array:
    """What f cos(theta_o) is multiplied by for each estimate, (N, BANDS + 1)."""
    band = np.minimum((to_angles(wi)[0] * (BANDS / (np.pi / 2))).astype(int), BANDS - 1)
    out = np.zeros((len(wi), BANDS + 1))
    out[np.arange(len(wi)), band] = 1 / SOLID_ANGLES[band]
    out[:, BANDS] = wi[:, 2] / np.pi
    return out


def _variance(terms: Array, x: Array) -> Array:
    """Of sums over draws, terms (N, K, C) at x (N, d): (K, C)."""
    k = min(NEIGHBOURS, len(x))
    _, near = cKDTree(x).query(x, k)
    near = near.reshape(len(x), k)
    apart = terms - terms[near].mean(1)
    return k / (k - 1) * (apart**2).sum(0)


def _integral(control: Control) -> tuple[Array, Array]:
    """Of f^ over each band, and the square of its error, by quasi-random numbers of several randomisations."""
    pool = Pool(0.25 * control.t0)
    rng = np.random.default_rng(0)
    found = np.array([_by(pool, control.eval, CONTROL, rng) for _ in range(SCRAMBLES)])
    return found.mean(0), found.var(0, ddof=1) / SCRAMBLES


def _by(pool: Pool, evaluate: Callable[[Array, Array], Array], count: int, rng: np.random.Generator) -> Array:
    wi, wo = pool.candidates(count, rng)
    weighted = evaluate(wi, wo) * (wo[:, 2] * np.exp(-pool.log_prob(wi, wo)) / count)[:, None]
    return np.einsum("nk,nc->kc", _integrands(wi), weighted)
