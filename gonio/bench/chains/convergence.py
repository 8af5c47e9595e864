"""Does every proposal converge to the same value? The thesis' test (3.14), against quadrature.

The integral is J = ∫∫ f cos(theta_o) |wd.n| |wi.wo| dwi dwo with |wd.n| = cos(theta_d); f is the mean of the channels.
A chain gives it up to the constant c = ∫∫ f cos(theta_o): J / c is the mean of cos(theta_d) |wi.wo| over its states,
weighted by f cos / p. Its Monte Carlo standard error comes from the weighted residuals' autocorrelation, and "within"
is the distance to the quadrature in those errors. A proposal is called converged where R-hat < 1.01.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.atomic import beside
from gonio.bench.drive import Driven, drive, truth_of
from gonio.brdf import Brdf
from gonio.config.loader import Section
from gonio.geometry import Array, above_horizon, to_half_diff
from gonio.mcmc.chain.pilot import pilot_directions
from gonio.mcmc.diagnostics import mcse_mean, rhat
from gonio.mcmc.plans.auto import fit_shares, isotropic_dictionary
from gonio.mcmc.proposals.independence import Mixture


class Config(Section):
    """chains x steps of every proposal on every material; the first `burn_in` share of a chain is left out."""

    study: Literal["convergence"]
    materials: tuple[str, ...]
    proposals: dict[str, dict]
    chains: int = 32
    steps: int = 4000
    burn_in: float = 0.2
    seed: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    head = f"{'material':22}{'proposal':14}{'measured':>9}{'J/c':>9}{'truth':>9}{'MCSE':>9}{'within':>8}{'R-hat':>8}"
    say(head + "  verdict")
    curves: dict[str, dict] = {}
    wrong = false_alarms = 0
    for material in config.materials:
        brdf = truth_of(material)
        truth, error = quadrature(brdf)
        curves[material] = {"truth": truth}
        for name, section in config.proposals.items():
            d = drive(brdf, section, 10**9, chains=config.chains, steps=config.steps, seed=config.seed)
            g, w = integrand(d, config.burn_in)
            value = float((w * g).sum() / w.sum())
            mcse = float(np.hypot(mcse_mean(w * (g - value) / w.mean()), error))
            distance, r = abs(value - truth) / mcse, rhat(g)
            converged = r < 1.01
            verdict = "converged" if converged else "not yet, and says so"
            if distance > 3:
                wrong += 1
                false_alarms += converged
                verdict += ", FAR FROM TRUTH" if converged else ", far from truth"
            numbers = f"{d.measurements:9}{value:9.5f}{truth:9.5f}{mcse:9.5f}{distance:8.2f}{r:8.4f}"
            say(f"{material:22}{name:14}{numbers}  {verdict}")
            curves[material][name] = running(d)
    cells = len(config.materials) * len(config.proposals)
    say(f"within 3 MCSE: {cells - wrong} of {cells}; declared converged by R-hat though far from truth: {false_alarms}")
    plot(curves, out / "figure_3_1.png")
    say(f"figure {out / 'figure_3_1.png'}")


def integrand(d: Driven, burn_in: float) -> tuple[Array, Array]:
    """g = cos(theta_d) |wi.wo| and weights f cos / p, both (chains, steps)."""
    g = d.chains(_g(d.wi, d.wo), burn_in)
    f_cos = d.chains(d.f.mean(1) * d.wo[:, 2], burn_in)
    return g, f_cos * np.exp(-d.log_p(burn_in))


def quadrature(brdf: Brdf, points: int = 2**18, scrambles: int = 4) -> tuple[float, float]:
    """J / c and its standard error, by scrambled Sobol points through a mixture of lobes fitted to the material."""
    from scipy.stats.qmc import Sobol

    density = _density(brdf)
    values = []
    for k in range(scrambles):
        uniform = Sobol(5, seed=k).random(points).T
        wi, wo = density.sample(uniform)
        ok = above_horizon(wi, wo)
        wi, wo = wi[ok], wo[ok]
        w = brdf.eval(wi, wo).mean(1) * wo[:, 2] / np.exp(density.log_prob(wi, wo))
        values.append((w * _g(wi, wo)).sum() / w.sum())
    return float(np.mean(values)), float(np.std(values, ddof=1) / np.sqrt(scrambles))


def _density(brdf: Brdf) -> Mixture:
    dictionary = isotropic_dictionary()
    wi, wo, log_q = pilot_directions(False)
    for _ in range(3):
        log_w = np.log(brdf.eval(wi, wo).mean(1) * wo[:, 2] + 1e-300) - log_q
        density = Mixture(dictionary, fit_shares(dictionary, wi, wo, log_w))
        wi, wo = density.sample(np.random.default_rng(0).random((5, 6000)))
        ok = above_horizon(wi, wo)
        wi, wo = wi[ok], wo[ok]
        log_q = density.log_prob(wi, wo)
    return density


def _g(wi: Array, wo: Array) -> Array:
    return np.cos(to_half_diff(wi, wo)[2]) * np.abs(np.sum(wi * wo, 1))


def running(d: Driven, points: int = 200) -> tuple[Array, Array]:
    """The estimate along the run: (measurements, value)."""
    g, w = integrand(d, 0.0)
    a, b = np.cumsum((w * g).sum(0)), np.cumsum(w.sum(0))
    at = np.unique(np.geomspace(1, len(a), points).astype(int)) - 1
    return (at + 1) / len(a) * d.measurements, (a / b)[at]


def plot(curves: dict[str, dict], path: Path) -> None:
    """Figure 3.1 of the thesis for every material."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.6 * len(curves), 3.6), layout="constrained")
    for axis, (material, lines) in zip(np.atleast_1d(figure.subplots(1, len(curves))), curves.items()):
        truth = lines.pop("truth")
        for name, (x, y) in lines.items():
            axis.semilogx(x, y / truth, lw=1, label=name)
        axis.axhline(1, color="k", lw=0.8)
        axis.set_ylim(0.9, 1.1)
        axis.set_title(material, fontsize=9)
        axis.set_xlabel("measurements")
    figure.axes[0].set_ylabel("estimate / truth")
    figure.axes[-1].legend(fontsize=7)
    with beside(path) as part:
        figure.savefig(part, dpi=110)
