"""Lambert + k GGX lobes with Schlick's Fresnel (Ngan 2005's family), k chosen by held-out error; log loss.

Given the roughnesses the rest is linear and non-negative (`robust_base.log_nnls`); lobes are added one by one, each the
best of a ladder of roughnesses, and the ladder is refined around those chosen. Long tails come out as wider lobes.
"""

import numpy as np

from gonio.brdf import Brdf, Ggx, Lambert, Mixture
from gonio.geometry import Array
from gonio.reconstruct.clean import clean
from gonio.reconstruct.grain import Grain
from gonio.reconstruct.held_out import EnergyError
from gonio.reconstruct.isotropic import Isotropic
from gonio.reconstruct.residual import LogRatio
from gonio.reconstruct.robust_base import log_nnls
from gonio.reconstruct.samples import Samples

LADDER = np.geomspace(0.003, 0.9, 14)
MOST_LOBES = 4
USED = 2000

LobesBrdf = Mixture


def fit(samples: Samples, *, anisotropic: bool, rng: np.random.Generator) -> Mixture:
    """Raises ReconstructionError for samples too few or too poor. Saturated readings are left out."""
    s = clean(samples)
    s = s[~s.saturated]
    s = s[rng.permutation(len(s))[:USED]]
    squeeze = _squeeze(s) if anisotropic else (1.0, 1.0)
    cos_o = s.wo[:, 2:3]
    g = s.f * cos_o
    floor = LogRatio.of(g, s.sigma * cos_o).floor
    held = np.arange(len(s)) % 5 == 0
    frame = Isotropic()
    angles = frame.angles(s.wi, s.wo)
    error = EnergyError(angles, g, s.sigma * cos_o, frame.stretch(0.1), np.flatnonzero(held))
    ladder: dict[float, Array] = {}

    def columns(alphas: list[float]) -> Array:
        for alpha in alphas:
            if alpha not in ladder:
                ladder[alpha] = _lobe(alpha, squeeze, s.wi, s.wo) * cos_o
        return np.concatenate([cos_o / np.pi, *(ladder[a] for a in alphas)], 1)

    def loss(alphas: list[float]) -> float:
        """Over the fitted samples: mean absolute log ratio, bright ones a little heavier."""
        x = columns(alphas)[~held]
        model = x @ log_nnls(x, g[~held], floor)
        bright = np.maximum(g[~held], 0) + floor
        return float((np.abs(np.log((model + floor) / bright)) * bright**0.1).mean())

    alphas: list[float] = []
    best, least = alphas, np.inf
    for _ in range(MOST_LOBES):
        alphas = min(([*alphas, float(a)] for a in LADDER if a not in alphas), key=loss)
        for step in (1.25, 1.1):
            for k in range(len(alphas)):
                near = [[*alphas[:k], alphas[k] * q, *alphas[k + 1 :]] for q in (1, step, 1 / step)]
                alphas = min(near, key=loss)
        x = columns(alphas)
        now = error(x[held] @ log_nnls(x[~held], g[~held], floor))
        if now < 0.98 * least:
            best, least = alphas, now
    return _mixture(best, log_nnls(columns(best), g, floor), squeeze)


def _squeeze(s: Samples) -> tuple[float, float]:
    """Factors of roughness along x and y: of the grain, to the nearest axis."""
    grain = Grain.of(s.wi, s.wo, np.maximum(s.f, 0))
    along_x = abs(np.cos(grain.psi)) > np.sqrt(0.5)
    return (grain.q, 1 / grain.q) if along_x else (1 / grain.q, grain.q)


def _lobe(alpha: float, squeeze: tuple[float, float], wi: Array, wo: Array) -> Array:
    """The lobe for Fresnel 1 and for Schlick's (1 - cos)^5 alone, (N, 2)."""
    whole = Ggx(alpha * squeeze[0], alpha * squeeze[1], f0=1.0).eval(wi, wo)
    rising = Ggx(alpha * squeeze[0], alpha * squeeze[1], f0=0.0).eval(wi, wo)
    return np.concatenate([whole, rising], 1)


def _mixture(alphas: list[float], weights: Array, squeeze: tuple[float, float]) -> Mixture:
    parts: list[Brdf] = [Lambert(weights[0])]
    share = [weights[0].mean() + 1e-3]
    for k, alpha in enumerate(alphas):
        plain, rising = weights[1 + 2 * k], weights[2 + 2 * k]
        total = plain + rising
        f0 = plain / np.where(total > 0, total, 1)
        parts.append(Ggx(alpha * squeeze[0], alpha * squeeze[1], f0=f0, weight=total))
        share.append(plain.mean() + 0.1 * rising.mean() + 1e-3)
    return Mixture(parts, share)
