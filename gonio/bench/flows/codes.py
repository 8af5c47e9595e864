"""How well the conditional flow knows materials it never saw: KL(target || flow) with only the code fitted.

On the networks kept from every pretraining; the code from `samples` draws of the target, from twenty times as many, and
from a run of so many measurements (pilot included, each weighted f / q), beside the mixture of lobes `auto` ends with.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.bench.drive import driven_by, truth_of
from gonio.bench.flows.pretrain import target_of, validation
from gonio.config.loader import Section
from gonio.flow import shipped
from gonio.flow.cubes import make_cube
from gonio.flow.density import FlowDensity
from gonio.flow.pool import divergence, resampled, weighted
from gonio.mcmc.proposals.independence import Mixture


class Config(Section):
    """weights: the conditional flow's file, the one that ships if none is named. materials: names besides networks."""

    study: Literal["codes"]
    archive: str
    weights: str | None = None
    materials: tuple[str, ...] = ()
    samples: int = 300
    even: int = 40_000


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    flow, codes = shipped.load_conditional(config.weights) if config.weights else shipped.conditional()
    cube = make_cube("half", 0.1)
    heads = (f"{config.samples} draws", f"{20 * config.samples} draws", "run, code", "run, lobes")
    say(f"{'KL in nats':34}" + "".join(f"{h:>14}" for h in heads))
    table = []
    for name in [*config.materials, *(f"{config.archive}:{n}" for n in validation(config.archive))]:
        rng, brdf = np.random.default_rng(1), truth_of(name)
        x, log_w = weighted(cube, target_of(brdf, rng), config.even, rng)
        row = []
        for count in (config.samples, 20 * config.samples):
            draws = resampled(x, log_w, count, rng)
            fitted = flow.at(codes.fit(flow, draws, np.ones(count)))
            row.append(divergence(FlowDensity(fitted, cube), cube, x, log_w))
        section = {"proposal": "flow", "flow": {"train": False, "weights": config.weights}}
        _, sampler = driven_by(brdf, section, config.samples, seed=1)
        row.append(divergence(sampler.plan.density, cube, x, log_w))
        _, sampler = driven_by(brdf, {"proposal": "auto"}, config.samples, seed=1)
        row.append(divergence(Mixture(sampler.plan.dictionary, sampler.plan.shares), cube, x, log_w))
        table.append(row)
        say(f"{name.split(':')[-1]:34}" + "".join(f"{v:14.4f}" for v in row))
    say(f"{'median':34}" + "".join(f"{v:14.4f}" for v in np.median(table, 0)))
