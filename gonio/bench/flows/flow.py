"""Flows as proposals: with ours from the code and from the zoo, trained as the thesis did, and without (`auto`).

Each run is driven to `adapt` measurements, then on to `measurements`; figures are of what came after `adapt`:

    ESS         effective samples per measurement, as in the study `sampling`
    accept      accepted steps per measurement
    imp. ESS    importance ESS of the density drawn from at the end, against the truth
    KL          KL(target || that density) in nats: what held-out likelihood lacks of its optimum
    energy      energy_mean of the referee, model `auto`, from all the run's samples (`auto` stands for any model)
    CPU         seconds of the whole run, reconstruction apart
    lost        a part of the target (4 x 4 cells of theta_i and the half cube's radius, of 2 % or more) that got less
                than a fifth of its due; or a chain that stayed where it was for 200 steps; or imp. ESS < 0.1
"""

import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gonio.bench.chains.effective_samples import worth
from gonio.bench.drive import Driven, driven_by, truth_of
from gonio.bench.flows.pretrain import target_of
from gonio.brdf import Brdf
from gonio.config.loader import Section
from gonio.evaluate import evaluate
from gonio.flow.cubes import make_cube
from gonio.flow.density import FlowDensity
from gonio.flow.pool import divergence, weighted
from gonio.geometry import Array
from gonio.reconstruct import reconstruct
from gonio.reconstruct.samples import Samples

STUCK = 200
EVEN = 40_000


class Config(Section):
    """variants: sampler sections by name. compared: materials over which ESS is compared with `reference`'s."""

    study: Literal["flow"]
    materials: tuple[str, ...]
    variants: dict[str, dict]
    compared: tuple[str, ...] = ()
    reference: str = "auto"
    adapt: int = 1000
    measurements: int = 3000
    chains: int = 4
    seeds: int = 1
    energy: bool = True
    workers: int = 2


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    head = (
        f"{'material':20}{'variant':>10}{'ESS':>8}{'accept':>8}{'imp. ESS':>10}{'KL':>8}{'energy':>8}{'CPU s':>8}  lost"
    )
    say(head)
    rows: dict[tuple[str, str], list[Array]] = {}
    lost: dict[str, list[str]] = {name: [] for name in config.variants}
    tasks = [(m, n, k) for m in config.materials for n in config.variants for k in range(1, config.seeds + 1)]
    with ProcessPoolExecutor(config.workers, mp_context=get_context("spawn")) as pool:
        done = pool.map(_task, ((config, *t) for t in tasks))
        for (material, name, seed), (figures, why) in zip(tasks, done):
            rows.setdefault((material, name), []).append(figures)
            lost[name] += [f"{material} (seed {seed}): {w}" for w in why]
            if seed == config.seeds:
                e, a, i, k, g, c = np.mean(rows[material, name], 0)
                mine = sum(w.startswith(material + " ") for w in lost[name])
                say(f"{material:20}{name:>10}{e:8.3f}{a:8.2f}{i:10.3f}{k:8.3f}{g:8.3f}{c:8.1f}  {mine}")
    for name in config.variants:
        mean = np.mean([np.mean(rows[m, name], 0) for m in config.materials], 0)
        say(
            f"{'mean':20}{name:>10}"
            + "".join(f"{v:{w}.{d}f}" for v, w, d in zip(mean, (8, 8, 10, 8, 8, 8), (3, 2, 3, 3, 3, 1)))
        )
        runs = len({w.split(":")[0] for w in lost[name]})
        say(f"{'':30}  lost in {runs} of {len(config.materials) * config.seeds} runs")
        for w in lost[name][:5]:
            say(f"{'':30}    {w}")
    for name in config.variants:
        if name != config.reference and config.compared:
            ratio = [np.mean(rows[m, name], 0)[0] / np.mean(rows[m, config.reference], 0)[0] for m in config.compared]
            say(f"{name} : {config.reference}, ESS on {', '.join(config.compared)}: {np.mean(ratio):.2f}")


def _task(task: tuple[Config, str, str, int]) -> tuple[Array, list[str]]:
    config, material, name, seed = task
    return one(truth_of(material), config.variants[name], config, seed)


def one(brdf: Brdf, section: dict[str, Any], config: Config, seed: int) -> tuple[Array, list[str]]:
    """ESS, accept, importance ESS, KL, energy, CPU seconds; and what was lost."""
    began = time.process_time()
    whole, sampler = driven_by(brdf, section, config.measurements, chains=config.chains, seed=seed)
    cpu = time.process_time() - began
    late = after(whole, config.adapt)
    ess, accepted, _ = worth(late, 0.0)
    cube = make_cube("half", 0.1)
    rng = np.random.default_rng(1)
    x, log_w = weighted(cube, target_of(brdf, rng), EVEN, rng)
    density = density_of(sampler.plan)
    wi, wo = cube.to_directions(x)
    log_q = density.log_prob(wi, wo) + cube.log_jacobian(x, wi, wo) + np.log(4 * np.pi)
    log_w -= log_w.max()
    importance = float(np.mean(np.exp(log_w)) ** 2 / np.mean(np.exp(2 * log_w - log_q)))
    kl = divergence(density, cube, x, log_w)
    energy = np.nan
    if config.energy:
        fitted = reconstruct(Samples.of(whole.wi, whole.wo, whole.f), "auto")
        energy = evaluate(fitted, brdf)["energy_mean"]
    why = missing(late, x, log_w)
    if importance < 0.1:
        why.append(f"importance ESS {importance:.3f}")
    return np.array([ess, accepted, importance, kl, energy, cpu]), why


def density_of(plan) -> Any:
    """What the plan draws from at last; the walk of `adapt: thesis` has its flow for that."""
    proposal = plan.kernels[0][0]
    density = getattr(proposal, "screened", None) or proposal.density
    assert isinstance(density, FlowDensity) or hasattr(density, "log_prob")
    return density


def after(d: Driven, measurements: int) -> Driven:
    """The part of a run that came after so many measurements: steps whose proposals are later ones."""
    s = d.steps
    count = int(s.chain.max()) + 1
    of_chains = np.flatnonzero(s.step >= 0)
    ids = s.id[of_chains]
    first = int(np.argmax(ids >= measurements)) // count * count
    keep = of_chains[first:]
    part = type(s)(**{k: getattr(s, k)[keep] for k in s.__dataclass_fields__})
    lowest = int(part.id[part.id >= 0].min())
    return Driven(part, d.wi, d.wo, d.f, d.measurements - lowest)


def missing(d: Driven, x: Array, log_w: Array) -> list[str]:
    """What the chains' states lack of the target, and chains that stood still."""
    cube = make_cube("half", 0.1)
    state = d.steps.state[d.steps.state >= 0]
    y = cube.from_directions(d.wi[state], d.wo[state])
    w = np.exp(log_w)
    edges = [np.quantile(x[:, k], np.linspace(0, 1, 5)[1:-1]) for k in (0, 2)]
    cell = lambda p: 4 * np.searchsorted(edges[0], p[:, 0]) + np.searchsorted(edges[1], p[:, 2])
    due = np.bincount(cell(x), w, 16) / w.sum()
    got = np.bincount(cell(y), minlength=16) / len(y)
    out = [f"cell {k} got {got[k]:.3f} of {due[k]:.3f}" for k in range(16) if due[k] >= 0.02 and got[k] < due[k] / 5]
    count = int(d.steps.chain.max()) + 1
    for c in range(count):
        moved = np.flatnonzero(d.steps.accepted[d.steps.chain == c])
        longest = np.diff(np.concatenate([[-1], moved, [int((d.steps.chain == c).sum())]])).max()
        if longest > STUCK:
            out.append(f"chain {c} stood still for {longest} steps")
    return out
