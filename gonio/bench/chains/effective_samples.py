"""What a measurement is worth: effective samples, and measurements to a given error, by proposal and material.

ESS is the smallest bulk ESS over theta_h, theta_d and |phi_d| of the chains' states, per measurement (the pilot's are
counted). "albedo" is the number of measurements after which the Monte Carlo standard error of the albedo in each of
nine bands of theta_i (of equal solid angle) is below 1 %, extrapolated by 1/sqrt(N) from the run itself.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.bench.drive import Driven, drive, truth_of
from gonio.config.loader import Section
from gonio.geometry import to_half_diff
from gonio.mcmc.diagnostics import ess_bulk, mcse_mean


class Config(Section):
    """Each proposal's section and the measurements its run may take; `reference` is what others are compared with."""

    study: Literal["sampling"]
    materials: tuple[str, ...]
    proposals: dict[str, dict | str]
    measurements: dict[str, int]
    reference: str = "thesis"
    chains: int = 4
    burn_in: float = 0.1
    seed: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    names = list(config.proposals)
    say(f"{'material':22}" + "".join(f"{n + ' ESS':>18}{'accept':>8}{'albedo':>10}" for n in names))
    table = []
    for material in config.materials:
        brdf = truth_of(material)
        row = []
        for name in names:
            section, budget = config.proposals[name], config.measurements[name]
            began = time.process_time()
            d = drive(brdf, section, budget, chains=config.chains, seed=config.seed)
            row.append((*worth(d, config.burn_in), time.process_time() - began))
        table.append(row)
        say(f"{material:22}" + "".join(f"{e:18.4f}{a:8.2f}{n:10.0f}" for e, a, n, _ in row))
    mean = np.mean(np.array(table), axis=0)
    say(f"{'mean':22}" + "".join(f"{e:18.4f}{a:8.2f}{n:10.0f}" for e, a, n, _ in mean))
    if config.reference in names:
        r = names.index(config.reference)
        ratio = np.array(table)
        for k, name in enumerate(names):
            if k != r:
                ess = mean[k, 0] / mean[r, 0]
                albedo = np.exp(np.mean(np.log(ratio[:, r, 2] / ratio[:, k, 2])))
                say(f"{name} : {config.reference}   ESS per measurement {ess:.1f} x, to 1 % albedo 1 : {albedo:.1f}")


def worth(d: Driven, burn_in: float) -> tuple[float, float, float]:
    """ESS per measurement, acceptance per measurement, measurements to 1 % MCSE of the albedo in nine bands."""
    theta_h, _, theta_d, phi_d = to_half_diff(d.wi, d.wo)
    used = 1 - burn_in
    ess = min(ess_bulk(d.chains(q, burn_in)) for q in (theta_h, theta_d, np.abs(phi_d))) / (used * d.measurements)
    accepted = d.steps.accepted.sum() / d.measurements
    w = d.chains(d.f.mean(1) * d.wo[:, 2], burn_in) * np.exp(-d.log_p(burn_in))
    band = d.chains(np.minimum((9 * d.wi[:, 2]).astype(int), 8), burn_in)
    need = 0.0
    for k in range(9):
        inside = w * (band == k)
        share = inside.mean() / w.mean()
        if share > 0:
            error = mcse_mean((inside - share * w) / w.mean()) / share
            need = max(need, used * d.measurements * (error / 0.01) ** 2)
        else:
            need = np.inf
    return float(ess), float(accepted), float(need)
