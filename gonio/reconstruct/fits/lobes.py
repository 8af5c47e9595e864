"""Lambert + k microfacet lobes with Schlick's Fresnel (Ngan 2005's family), k chosen by held-out error; log loss.

Given roughnesses and tails the rest is linear and non-negative (`robust_base.log_nnls`); lobes are added one by one,
each the best of a ladder of roughnesses, and refined around those chosen. Tails: all lobes GGX, or each lobe with the
exponent gamma that suits it (Student-t slopes, of which GGX is one); held-out samples decide between the two.
"""

from collections.abc import Callable

import numpy as np

from gonio.brdf import Brdf, Lambert, Mixture
from gonio.brdf.models.student import Student
from gonio.geometry import Array
from gonio.reconstruct.clean import clean
from gonio.reconstruct.samples import Samples
from gonio.reconstruct.splines.grain import Grain
from gonio.reconstruct.splines.held_out import EnergyError
from gonio.reconstruct.splines.isotropic import Isotropic
from gonio.reconstruct.splines.residual import LogRatio
from gonio.reconstruct.splines.robust_base import log_nnls

LADDER = np.geomspace(0.003, 0.9, 14)
GGX = 2.0
GAMMAS = (1.6, 1.8, GGX, 2.5, 4.0, 8.0)
MOST_LOBES = 4
USED = 2000

Lobe = tuple[float, float]
"""alpha, gamma."""


def fit(samples: Samples, *, anisotropic: bool, rng: np.random.Generator) -> Mixture:
    """Raises ReconstructionError for samples too few or too poor. Saturated readings are left out."""
    s = clean(samples)
    s = s[~s.saturated]
    s = s[rng.permutation(len(s))[:USED]]
    p = _Problem(s, _squeeze(s) if anisotropic else (1.0, 1.0))
    plain, error = _grown(p, _wider_or_narrower)
    tailed, error_tailed = _grown(p, lambda lobe, step: _wider_or_narrower(lobe, step) + _other_tails(lobe))
    best = tailed if error_tailed < error else plain
    return _mixture(best, log_nnls(p.columns(best), p.g, p.floor), p.squeeze)


class _Problem:
    """Samples, and the columns of lobes made so far."""

    def __init__(self, s: Samples, squeeze: tuple[float, float]):
        self.s, self.squeeze = s, squeeze
        self.cos_o = s.wo[:, 2:3]
        self.g = s.f * self.cos_o
        self.floor = LogRatio.of(self.g, s.sigma * self.cos_o).floor
        self.held = np.arange(len(s)) % 5 == 0
        frame = Isotropic()
        angles, stretch = frame.angles(s.wi, s.wo), frame.stretch(0.1)
        self._error = EnergyError(angles, self.g, s.sigma * self.cos_o, stretch, np.flatnonzero(self.held))
        self._bright = np.maximum(self.g[~self.held], 0) + self.floor
        self._made: dict[Lobe, Array] = {}

    def columns(self, lobes: list[Lobe]) -> Array:
        """Lambert's, then two a lobe: for Fresnel 1 and for Schlick's (1 - cos)^5 alone; times cos(theta_o)."""
        for lobe in lobes:
            if lobe not in self._made:
                both = [_student(lobe, self.squeeze, f0).eval(self.s.wi, self.s.wo) for f0 in (1.0, 0.0)]
                self._made[lobe] = np.concatenate(both, 1) * self.cos_o
        return np.concatenate([self.cos_o / np.pi, *(self._made[k] for k in lobes)], 1)

    def loss(self, lobes: list[Lobe]) -> float:
        """Over the fitted samples: mean absolute log ratio, bright ones a little heavier."""
        x = self.columns(lobes)[~self.held]
        model = x @ log_nnls(x, self.g[~self.held], self.floor)
        return float((np.abs(np.log((model + self.floor) / self._bright)) * self._bright**0.1).mean())

    def held_out_error(self, lobes: list[Lobe]) -> float:
        x = self.columns(lobes)
        return self._error(x[self.held] @ log_nnls(x[~self.held], self.g[~self.held], self.floor))


def _grown(p: _Problem, near: Callable[[Lobe, float], list[Lobe]]) -> tuple[list[Lobe], float]:
    """Lobes added while they make the held-out error smaller, each moved to the best of those `near` it; the error."""
    lobes: list[Lobe] = []
    best, least = lobes, np.inf
    for _ in range(MOST_LOBES):
        ladder = [(float(a), GGX) for a in LADDER]
        lobes = min(([*lobes, k] for k in ladder if k not in lobes), key=p.loss)
        for step in (1.25, 1.1):
            for k in range(len(lobes)):
                lobes = min([[*lobes[:k], other, *lobes[k + 1 :]] for other in near(lobes[k], step)], key=p.loss)
        now = p.held_out_error(lobes)
        if now < 0.98 * least:
            best, least = lobes, now
    return best, least


def _wider_or_narrower(lobe: Lobe, step: float) -> list[Lobe]:
    return [(lobe[0] * q, lobe[1]) for q in (1, step, 1 / step)]


def _other_tails(lobe: Lobe) -> list[Lobe]:
    """The neighbouring exponents, the width at half maximum kept."""
    k = GAMMAS.index(lobe[1])
    others = [GAMMAS[j] for j in (k - 1, k + 1) if 0 <= j < len(GAMMAS)]
    return [(lobe[0] * float(np.sqrt((2 ** (1 / lobe[1]) - 1) / (2 ** (1 / g) - 1))), g) for g in others]


def _student(lobe: Lobe, squeeze: tuple[float, float], f0, weight=1.0) -> Student:
    return Student(lobe[0] * squeeze[0], lobe[0] * squeeze[1], f0, gamma=lobe[1], weight=weight)


def _squeeze(s: Samples) -> tuple[float, float]:
    """Factors of roughness along x and y: of the grain, to the nearest axis."""
    grain = Grain.of(s.wi, s.wo, np.maximum(s.f, 0))
    along_x = abs(np.cos(grain.psi)) > np.sqrt(0.5)
    return (grain.q, 1 / grain.q) if along_x else (1 / grain.q, grain.q)


def _mixture(lobes: list[Lobe], weights: Array, squeeze: tuple[float, float]) -> Mixture:
    parts: list[Brdf] = [Lambert(weights[0])]
    share = [weights[0].mean() + 1e-3]
    for k, lobe in enumerate(lobes):
        plain, rising = weights[1 + 2 * k], weights[2 + 2 * k]
        total = plain + rising
        f0 = plain / np.where(total > 0, total, 1)
        parts.append(_student(lobe, squeeze, f0, total))
        share.append(plain.mean() + 0.1 * rising.mean() + 1e-3)
    return Mixture(parts, share)
