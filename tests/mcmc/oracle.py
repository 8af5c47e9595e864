"""One statistical oracle for every proposal: where many independent chains are after a while, against quadrature.

Chains are independent of each other, so their states after the same number of steps are independent draws: a plain
chi-square test applies, with no autocorrelation to correct for.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.geometry import above_horizon, from_half_diff, to_half_diff
from gonio.mcmc.plans.blind import Blind
from gonio.mcmc.sampler import Sampler
from gonio.mcmc.target import Target


def glossy(alpha=0.3, alpha_y=None):
    return Mixture([Lambert(0.25), Ggx(alpha, alpha_y, 0.6)])


@dataclass
class Bins:
    """Cells in (theta_h, theta_d, phi_d[, phi_h]) of near-equal target mass, their exact shares, and the exact mean."""

    edges: list
    share: np.ndarray
    mean: np.ndarray

    def histogram(self, wi, wo):
        x = coordinates(wi, wo)[: len(self.edges)]
        cell = [np.clip(np.searchsorted(e, v, "right") - 1, 0, len(e) - 2) for e, v in zip(self.edges, x)]
        return np.bincount(np.ravel_multi_index(cell, self.share.shape), minlength=self.share.size).reshape(
            self.share.shape
        )


def coordinates(wi, wo):
    theta_h, phi_h, theta_d, phi_d = to_half_diff(wi, wo)
    return theta_h, theta_d, np.abs(phi_d), phi_h % (2 * np.pi)


def exact_bins(brdf, target, counts=(6, 4, 3), support=None, fine=(240, 96, 48), anisotropic=0):
    """Quadrature of the target over a fine midpoint grid; `anisotropic` = cells of phi_h, 0 for none."""
    axes = [(np.arange(n) + 0.5) / n * top for n, top in zip(fine, (np.pi / 2, np.pi / 2, np.pi))]
    # theta_h on a squared scale: the peak is narrow
    axes[0] = (np.pi / 2) * ((np.arange(fine[0]) + 0.5) / fine[0]) ** 2
    axes.append((np.arange(24) + 0.5) / 24 * 2 * np.pi if anisotropic else np.array([0.0]))
    grid = np.meshgrid(*axes, indexing="ij")
    th, td, pd, ph = (g.ravel() for g in grid)
    wi, wo = from_half_diff(th, ph, td, pd)
    weight = np.zeros(len(th))
    ok = above_horizon(wi, wo)
    if support is not None:
        ok[ok] = support(wi[ok], wo[ok])
    p = np.exp(target.log_prob(brdf.eval(wi[ok], wo[ok]), wi[ok], wo[ok]))
    weight[ok] = p * 4 * np.cos(td[ok]) * np.sin(td[ok]) * np.sin(th[ok]) * np.sqrt(th[ok])
    weight = (weight / weight.sum()).reshape(grid[0].shape)
    edges, cells = [], []
    wanted = [*counts, anisotropic] if anisotropic else list(counts)
    for k, n in enumerate(wanted):
        marginal = np.cumsum(weight.sum(tuple(j for j in range(4) if j != k)))
        cut = np.searchsorted(marginal, np.arange(1, n) / n)
        middle = 0.5 * (axes[k][1:] + axes[k][:-1])
        if k == 0:
            middle = (np.pi / 2) * (np.arange(1, fine[0]) / fine[0]) ** 2
        edges.append(np.concatenate([[-np.inf], middle[cut], [np.inf]]))
        cells.append(np.searchsorted(middle[cut], axes[k], "right"))
    share = weight.sum(3) if not anisotropic else weight
    for k, cell in enumerate(cells):
        share = np.stack([share.take(np.flatnonzero(cell == c), axis=k).sum(k) for c in range(wanted[k])], k)
    mean = np.array([(weight.ravel() * np.cos(th)).sum(), (weight.ravel() * np.cos(td)).sum()])
    return Bins(edges, share, mean)


class Known(Blind):
    """A running reconstruction that is what it was told to be."""

    def __init__(self, brdf):
        super().__init__(brdf.channels)
        self.eval = brdf.eval

    def coordinates(self, wi, wo):
        theta_h, theta_d, phi_d, _ = coordinates(wi, wo)  # not the azimuth: as for an isotropic sample
        d = np.sin(theta_d)
        return np.stack([np.arcsinh(theta_h / self.t0), theta_d, d * np.cos(phi_d), d * np.sin(phi_d)], 1)


def run(plan, brdf, *, chains, steps, target=None, seed=1, reachable=None, noise=0.0, shuffle=False, anisotropic=False):
    """A sampler after `steps` steps of every chain. noise: relative, unbiased, non-negative (pseudo-marginal)."""
    target = target or Target(0, 1.0, 0.0, brdf.channels)
    sampler = Sampler(
        plan, target, chains=chains, channels=brdf.channels, seed=seed, reachable=reachable, anisotropic=anisotropic
    )
    rng = np.random.default_rng(seed + 1000)
    while sampler.step < steps:
        batch = sampler.ask()
        f = brdf.eval(batch.wi, batch.wo)
        if noise:
            f = f * rng.choice([1 - noise, 1 + noise], size=(len(f), 1))
        order = np.arange(len(f))
        if shuffle:
            rng.shuffle(order)
            for part in np.array_split(order, 3):
                sampler.tell(batch.ids[part], f[part])
        else:
            sampler.tell(batch.ids, f)
    return sampler


def p_value(sampler, bins):
    """Chi-square of the chains' present states against the exact shares; cells below 5 expected are put together."""
    seen = bins.histogram(sampler.chains.wi, sampler.chains.wo).ravel().astype(float)
    expected = bins.share.ravel() * sampler.count
    small = expected < 5
    seen, expected = np.append(seen[~small], seen[small].sum()), np.append(expected[~small], expected[small].sum())
    if expected[-1] < 1e-3 * sampler.count:
        seen, expected = seen[:-1], expected[:-1]
    return chi2.sf(np.sum((seen - expected) ** 2 / expected), len(seen) - 1)


def mean_error(sampler, bins):
    """Largest deviation of the means of cos theta_h and cos theta_d, in standard errors (draws are independent)."""
    theta_h, theta_d, *_ = coordinates(sampler.chains.wi, sampler.chains.wo)
    x = np.cos(np.stack([theta_h, theta_d]))
    return np.max(np.abs(x.mean(1) - bins.mean) / (x.std(1) / np.sqrt(x.shape[1])))
