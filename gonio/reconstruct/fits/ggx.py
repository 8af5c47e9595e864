"""One GGX lobe with Schlick's Fresnel, isotropic or along the sample's axes."""

from collections.abc import Callable

import numpy as np

from gonio.brdf import Ggx
from gonio.geometry import Array
from gonio.reconstruct.clean import usable
from gonio.reconstruct.fits.log_nnls import log_nnls
from gonio.reconstruct.samples import Samples

Solve = Callable[[Array, int], Array]
"""Columns (N, 2) of f cos(theta_o) and a channel -> the two amounts, >= 0."""

ALPHAS = np.geomspace(1e-3, 1.0, 31)


def fit(samples: Samples, *, anisotropic: bool, rng: np.random.Generator) -> Ggx:
    """The lobe of least logarithmic error of f cos(theta_o), its colours by non-negative least squares inside.

    Starts from the best of a grid of roughnesses, then Nelder-Mead over their logarithms. Raises ReconstructionError.
    """
    s = usable(samples)
    target = s.f * s.wo[:, 2:]
    # of the mean, unlike that of several lobes: one lobe alone that also minds the dark loses the peak
    floor = np.maximum(1e-3 * target.mean(0), 1e-300) + s.sigma * s.wo[:, 2:]
    log_target = np.log(target + floor)

    def loss(brdf: Ggx) -> float:
        fitted = brdf.eval(s.wi, s.wo) * s.wo[:, 2:]
        return float(np.mean((np.log(fitted + floor) - log_target) ** 2))

    return _search(s, lambda columns, c: log_nnls(columns, target[:, c], floor[:, c]), loss, anisotropic)


def fit_cosine_weighted(samples: Samples) -> Ggx:
    """The isotropic lobe of least cosine-weighted square error, (4.1) of the thesis. Raises ReconstructionError."""
    s = usable(samples)
    target = s.f * s.wo[:, 2:]

    def loss(brdf: Ggx) -> float:
        return float(np.mean((brdf.eval(s.wi, s.wo) * s.wo[:, 2:] - target) ** 2))

    def solve(columns: Array, c: int) -> Array:
        from scipy.optimize import nnls

        scale = np.maximum(columns.max(0), 1e-300)
        return nnls(columns / scale, target[:, c])[0] / scale

    return _search(s, solve, loss, False)


def _search(s: Samples, solve: Solve, loss: Callable[[Ggx], float], anisotropic: bool) -> Ggx:
    from scipy.optimize import minimize

    def lobe(log_alpha: Array) -> Ggx:
        alpha_x, alpha_y = np.exp(np.clip(np.broadcast_to(log_alpha, 2), np.log(1e-5), np.log(2.0)))
        return _coloured(s, solve, float(alpha_x), float(alpha_y))

    def cost(log_alpha: Array) -> float:
        return loss(lobe(log_alpha))

    starts = [np.array([a]) for a in np.log(ALPHAS)]
    if anisotropic:
        coarse = np.log(ALPHAS[::5])
        starts = [np.array([a, b]) for a in coarse for b in coarse]
    best = min(starts, key=cost)
    step = np.log(ALPHAS[1] / ALPHAS[0]) * (5 if anisotropic else 1)
    simplex = np.concatenate([best[None], best + step * np.eye(len(best))])
    options = {"initial_simplex": simplex, "xatol": 1e-4, "fatol": 0.0, "maxiter": 200}
    return lobe(minimize(cost, best, method="Nelder-Mead", options=options).x)


def _coloured(s: Samples, solve: Solve, alpha_x: float, alpha_y: float) -> Ggx:
    """The lobe of this roughness whose colours fit best: a + c s with a, c >= 0 per channel, s Schlick's term."""
    lobe = Ggx(alpha_x, alpha_y, f0=[1.0, 0.0]).eval(s.wi, s.wo)  # without Fresnel, with Schlick's alone
    a = np.array([solve(lobe * s.wo[:, 2:], c) for c in range(s.f.shape[1])])
    total = a.sum(1)
    return Ggx(alpha_x, alpha_y, f0=np.where(total > 0, a[:, 0] / np.where(total > 0, total, 1), 1.0), weight=total)
