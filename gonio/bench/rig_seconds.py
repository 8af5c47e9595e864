"""What each saving of motion is worth: the same measurements driven with the switches of `plan` on and off.

    gonio bench rig

The measurements are those that the material's own sampler asks for on the rig's reachable set, batch by batch. They are
driven by the simulated rig of depth `devices` as its YAML has it, noise included; `energy` is the energy error of the
default reconstruction from what was read, so that a saving that costs accuracy shows.
"""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.bench.drive import surrogate, truth_of
from gonio.brdf import Brdf
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.loader import Section
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.evaluate import evaluate
from gonio.geometry import Array
from gonio.mcmc import make_sampler
from gonio.reconstruct import Samples, reconstruct
from gonio.rigs import open_rig

Batches = list[tuple[Array, Array]]

# one switch after the other, each on top of those before it
STAIRS: tuple[tuple[str, dict], ...] = (
    ("one pose per pair, in drawn order", dict(branches=False, tour=False, free_azimuth=False)),
    ("+ branches", dict(tour=False, free_azimuth=False)),
    ("+ free azimuth, mirror images", dict(tour=False)),
    ("+ tour (the default)", dict()),
    ("+ reciprocity", dict(reciprocity=True)),
)


def asked(material: Material, truth: Brdf, rig: RigConfig) -> Batches:
    """What the material's sampler asks for, batch by batch, when it is told the truth without noise."""
    sampler = make_sampler(material, open_rig(rig, truth, 0).reachable, surrogate)
    batches, n, most = [], 0, material.budget.measurements or 10_000
    while n < most:
        batch = sampler.ask()
        f = truth.eval(batch.wi, batch.wo)
        sampler.tell(batch.ids, f, np.zeros_like(f))
        sampler.take_steps()
        left = most - n
        batches.append((batch.wi[:left], batch.wo[:left]))
        n += len(batches[-1][0])
    return batches


def drive(
    batches: Batches, truth: Brdf, rig_config: RigConfig, plan: PlanConfig, isotropic: bool
) -> tuple[float, Samples]:
    """Rig seconds that the batches take, one after the other, and what was measured."""
    rig = open_rig(rig_config, truth, 1, plan=plan, isotropic=isotropic)
    seen, first = [], 0
    for wi, wo in batches:
        seen += list(rig.visit(wi, wo, np.arange(first, first + len(wi))))
        first += len(wi)
    parts = {k: np.concatenate([getattr(v, k) for v in seen]) for k in ("wi", "wo", "f", "sigma", "saturated")}
    good = np.isfinite(parts["f"]).all(1)
    spent = float(sum(v.rig_s.sum() for v in seen))
    return spent, Samples.of(**{k: a[good] for k, a in parts.items()})


class Config(Section):
    """Materials, measurements of each, and the sizes of block that `auto` hands out."""

    study: Literal["rig"]
    materials: tuple[str, ...]
    measurements: int = 10_000
    blocks: tuple[int, ...] = (64,)
    rig: str = "sim"


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    rig = load_config(find_config(config.rig, "rigs"), RigConfig)
    for name in config.materials:
        for block in config.blocks:
            sets = [f"budget.measurements={config.measurements}", f"sampler.block={block}"]
            material = load_config(find_config(name, "materials"), Material, sets)
            _stairs(material, rig, say)


def _stairs(material: Material, rig: RigConfig, say: Callable[[str], None]) -> None:
    truth = truth_of(material.truth or material.name)
    batches = asked(material, truth, rig)
    n, isotropic = sum(len(wi) for wi, _ in batches), material.symmetry == "isotropic"
    say(f"{material.name}: {n} measurements, blocks of {material.sampler.block}, rig {rig.name}")
    say(f"{'':36}{'rig h':>8}{'s each':>8}{'fewer':>8}{'energy':>8}{'CPU s':>8}")
    before = None
    for name, switches in STAIRS:
        began = time.process_time()
        spent, samples = drive(batches, truth, rig, PlanConfig(**switches), isotropic)
        cpu = time.process_time() - began
        before = before or spent
        energy = evaluate(reconstruct(samples, anisotropic=not isotropic), truth)["energy_median"]
        say(f"{name:36}{spent / 3600:8.2f}{spent / n:8.3f}{before / spent:7.2f}x{energy:8.3f}{cpu:8.1f}")
