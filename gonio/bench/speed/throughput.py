"""How fast the chain itself is: steps per second beside emcee, microseconds of ask + tell, bytes of a stored step.

No rig and no store: BRDF values come from an analytic GGX. emcee's vectorised stretch move samples the same target in
the same coordinates in the same run. Medians of `repeats`.
"""

import resource
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.brdf.models.microfacet import Ggx
from gonio.config import Material
from gonio.config.loader import Section
from gonio.geometry import Array
from gonio.mcmc import Sampler, make_sampler
from gonio.mcmc.proposals.pss_simple import PssSimple
from gonio.mcmc.target import Target


class Config(Section):
    study: Literal["throughput"]
    chains: int = 1024
    rounds: int = 512
    repeats: int = 5
    alpha: float = 0.2
    stored_steps: int = 1_000_000


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    brdf = Ggx(config.alpha)
    ours, theirs = [], []
    for _ in range(config.repeats):
        ours.append(steps_per_second(brdf, config))
        theirs.append(emcee_steps_per_second(brdf, config))
    a, b = np.median(ours), np.median(theirs)
    say(f"{config.chains} chains, pss_simple, analytic GGX: {a:.3g} steps/s; emcee {b:.3g}; ratio {a / b:.1f}")
    for name in ("pss_simple", "auto"):
        each = np.median([ask_tell(name, brdf) for _ in range(config.repeats)])
        say(f"one chain, ask + tell, {name}: {each:.1f} us per measurement")
    say(memory(config, brdf))


def _sampler(proposal: str, chains: int) -> Sampler:
    section = {"proposal": proposal, "chains": chains, "target": {"channels": 0, "floor": 0.0}}
    return make_sampler(Material.model_validate({"name": "x", "channels": 1, "sampler": section}))


def steps_per_second(brdf: Ggx, config: Config) -> float:
    sampler = _sampler("pss_simple", config.chains)
    _rounds(sampler, brdf, 20)
    began = time.perf_counter()
    _rounds(sampler, brdf, config.rounds)
    return config.chains * config.rounds / (time.perf_counter() - began)


def _rounds(sampler: Sampler, brdf: Ggx, rounds: int) -> None:
    for k in range(rounds):
        batch = sampler.ask()
        sampler.tell(batch.ids, brdf.eval(batch.wi, batch.wo))
        if k % 64 == 63:
            sampler.take_steps()


def emcee_steps_per_second(brdf: Ggx, config: Config) -> float:
    """emcee 3, vectorised, on log W(u) = log p + log Jacobian over the same cube."""
    import emcee

    proposal = PssSimple(anisotropic=False, sigma=0.05, global_share=0.1, boundary="reflect")
    target = Target(0, 1.0, 0.0, 1)

    def log_prob(u: Array) -> Array:
        inside = ((u > 0) & (u < 1)).all(1)
        wi, wo, log_j = proposal.place(np.clip(u, 1e-12, 1 - 1e-12).T)
        ok = inside & (wi[:, 2] > 0) & (wo[:, 2] > 0)
        out = np.full(len(u), -np.inf)
        out[ok] = target.log_prob(brdf.eval(wi[ok], wo[ok]), wi[ok], wo[ok]) + log_j[ok]
        return out

    start = np.random.default_rng(0).uniform(0.05, 0.3, (config.chains, 3))
    sampler = emcee.EnsembleSampler(config.chains, 3, log_prob, vectorize=True)
    sampler.run_mcmc(start, 10)
    began = time.perf_counter()
    sampler.run_mcmc(None, config.rounds)
    return config.chains * config.rounds / (time.perf_counter() - began)


def ask_tell(proposal: str, brdf: Ggx, measurements: int = 3000) -> float:
    """Median microseconds per measurement of one chain, the BRDF's own time left out."""
    sampler = _sampler(proposal, 1)
    each, made = [], 0
    while made < measurements:
        began = time.perf_counter()
        batch = sampler.ask()
        middle = time.perf_counter()
        f = brdf.eval(batch.wi, batch.wo)
        resumed = time.perf_counter()
        sampler.tell(batch.ids, f)
        spent = time.perf_counter() - resumed + middle - began
        each += [spent / len(batch.ids)] * len(batch.ids)
        made += len(batch.ids)
    return float(np.median(each) * 1e6)


def memory(config: Config, brdf: Ggx) -> str:
    """Resident memory and time of a stored step log at half and at full length: linear or not."""
    sizes, seconds = [], []
    sampler = _sampler("pss_simple", config.chains)
    kept = []
    before = _rss()
    began = time.perf_counter()
    for goal in (config.stored_steps // 2, config.stored_steps):
        while sampler.step * config.chains < goal:
            _rounds(sampler, brdf, 8)
            kept.append(sampler.take_steps())
        sizes.append(sum(a.nbytes for s in kept for a in vars(s).values()) / 1e6)
        seconds.append(time.perf_counter() - began)
    return (
        f"{config.stored_steps:g} stored steps: {sizes[1]:.0f} MB of arrays, {_rss() - before:.0f} MB more resident; "
        f"half of them {sizes[0]:.0f} MB; {seconds[1]:.1f} s, the first half {seconds[0]:.1f} s"
    )


def _rss() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
