"""Löw's ABC model (2012), fitted so that it converges where the thesis's optimiser failed: a logarithmic loss, many
starts over (b, c), and the linear part, kd and a per channel, by non-negative least squares inside."""

import numpy as np

from gonio.brdf import Abc
from gonio.brdf.models.abc import lobe
from gonio.geometry import Array
from gonio.reconstruct.clean import usable
from gonio.reconstruct.errors import ReconstructionError
from gonio.reconstruct.fits.log_nnls import log_nnls
from gonio.reconstruct.samples import Samples
from gonio.reconstruct.splines.residual import LogRatio

# lobe half-widths of 0.05 to 60 degrees, tails from c = 0.6 to 4
WIDTHS = np.radians([0.05, 0.2, 0.6, 2.0, 6.0, 20.0, 60.0])
TAILS = (0.6, 1.0, 1.6, 2.5, 4.0)
ETA = (1.3, 1.5, 2.5, 8.0)
FEW = 2000  # samples that the starts are judged by
KEPT = 3  # starts that are followed to the end


def fit(samples: Samples, *, anisotropic: bool, rng: np.random.Generator) -> Abc:
    """The best of KEPT Nelder-Mead searches over log b, log c, log(eta - 1). Raises ReconstructionError."""
    from scipy.optimize import minimize

    if anisotropic:
        raise ReconstructionError("the ABC model is isotropic; take --model ggx, lobes or auto")
    s = usable(samples)
    few = s[rng.permutation(len(s))[:FEW]]
    starts = [_start(w, c, n) for w in WIDTHS for c in TAILS for n in ETA]
    judge = _Problem(few)
    starts = sorted(starts, key=judge.loss)
    kept = [starts[0]]
    for p in starts:  # good ones that differ in width or tail: near twins end in the same valley
        if len(kept) < KEPT and min(np.abs(p[:2] - q[:2]).max() for q in kept) > 0.5:
            kept.append(p)
    whole = _Problem(s)
    options = {"xatol": 1e-3, "fatol": 1e-6, "maxiter": 300}
    rough = [minimize(judge.loss, p, method="Nelder-Mead", options=options).x for p in kept]
    best = min(rough, key=whole.loss)
    return whole.brdf(minimize(whole.loss, best, method="Nelder-Mead", options=options | {"maxiter": 60}).x)


def _start(width: float, c: float, eta: float) -> Array:
    """Parameters of the lobe that has fallen to half at theta_h = width."""
    b = (2 ** (1 / c) - 1) / (2 * np.sin(width / 2) ** 2)
    return np.log([b, c, eta - 1])


class _Problem:
    """Samples and what is computed from them once."""

    def __init__(self, s: Samples):
        self.s, self.cos = s, s.wo[:, 2]
        self.target = s.f * self.cos[:, None]
        sigma = s.sigma * self.cos[:, None]
        self.floor = np.maximum(LogRatio.of(self.target, sigma).floor, 1e-300) + sigma
        self.log_target = np.log(self.target + self.floor)

    def loss(self, p: Array) -> float:
        """Mean squared logarithmic error of f cos(theta_o)."""
        kd, a, column = self._linear(p)
        fitted = self.cos[:, None] * kd / np.pi + column[:, None] * a
        return float(np.mean((np.log(fitted + self.floor) - self.log_target) ** 2))

    def brdf(self, p: Array) -> Abc:
        kd, a, _ = self._linear(p)
        return Abc(kd, a, *_shape(p))

    def _linear(self, p: Array) -> tuple[Array, Array, Array]:
        """kd, a (C,) of least logarithmic error, and the lobe's f cos(theta_o) at a = 1."""
        column = lobe(self.s.wi, self.s.wo, *_shape(p)) * self.cos
        columns = np.stack([self.cos / np.pi, column], -1)
        fits = [log_nnls(columns, t, e) for t, e in zip(self.target.T, self.floor.T)]
        kd, a = np.array(fits).T
        return kd, a, column


def _shape(p: Array) -> tuple[float, float, float]:
    """b, c, eta within bounds where their powers stay finite."""
    b, c, e = np.exp(np.clip(p, np.log([1e-2, 0.3, 0.01]), np.log([1e9, 20.0, 50.0])))
    return float(b), float(c), float(1 + e)
