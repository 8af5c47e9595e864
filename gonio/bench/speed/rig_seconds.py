"""What each saving of motion is worth: the same measurements driven with the switches of `plan` on and off.

    gonio bench rig

The measurements are those that the material's own sampler asks for on the rig's reachable set, batch by batch. They are
driven by the simulated rig of depth `devices` as its YAML has it, noise included; `energy` is the energy error of the
default reconstruction from what was read, so that a saving that costs accuracy shows. `wall/plan` is the time a row
took over that of its own plan: straight travel from pose to pose, settling, one exposure each. What a second thread
saves (`plan.overlap`) a virtual clock cannot show: see gonio.bench.speed.wire.
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
from gonio.rig.build import axes_of, park_pose
from gonio.rig.motion.profile import move_time
from gonio.run.open_rig import open_rig

Batches = list[tuple[Array, Array, Brdf | None]]  # wi, wo, and the surrogate that the sampler had by then

# one switch after the other, each on top of those before it
STAIRS: tuple[tuple[str, dict], ...] = (
    ("one pose per pair, in drawn order", dict(branches=False, tour=False, free_azimuth=False, predict_range=False)),
    ("+ branches", dict(tour=False, free_azimuth=False, predict_range=False)),
    ("+ free azimuth, mirror images", dict(tour=False, predict_range=False)),
    ("+ tour", dict(predict_range=False)),
    ("+ ranges predicted (the default)", dict()),
    ("+ reciprocity", dict(reciprocity=True)),
)
# the default with one thing changed: switches, backlash of every axis in degrees
ASIDES: tuple[tuple[str, dict, float], ...] = (
    ("default, but a dark for each reading", dict(dark_every=1), 0.0),
    ("backlash 0.25: from below always", dict(one_sided="always"), 0.25),
    ("backlash 0.25: where it matters", dict(one_sided="needed"), 0.25),
    ("backlash 0.25: never", dict(one_sided="never"), 0.25),
)


def asked(material: Material, truth: Brdf, rig: RigConfig) -> Batches:
    """What the material's sampler asks for, batch by batch, when it is told the truth without noise."""
    known: list[Brdf] = []

    def fit(wi: Array, wo: Array, f: Array, sigma: Array | None = None) -> Brdf:
        known[:] = [surrogate(wi, wo, f, sigma)]
        return known[0]

    batches: Batches = []
    n, most = 0, material.budget.measurements or 10_000
    sampler = make_sampler(material, open_rig(rig, truth, 0).reachable, fit, (most,))
    while n < most:
        batch = sampler.ask()  # may learn: what it knows now is asked for these
        f = truth.eval(batch.wi, batch.wo)
        sampler.tell(batch.ids, f, np.zeros_like(f))
        sampler.take_steps()
        left = most - n
        batches.append((batch.wi[:left], batch.wo[:left], known[0] if known else None))
        n += len(batches[-1][0])
    return batches


def drive(
    batches: Batches, truth: Brdf, rig_config: RigConfig, plan: PlanConfig, isotropic: bool
) -> tuple[float, float, Samples]:
    """Rig seconds that the batches take, one after the other; those of their own plan; what was measured."""
    rig = open_rig(rig_config, truth, 1, plan=plan, isotropic=isotropic)
    seen, first = [], 0
    for wi, wo, brdf in batches:
        rig.surrogate = None if brdf is None else brdf.eval
        seen += list(rig.visit(wi, wo, np.arange(first, first + len(wi))))
        first += len(wi)
    parts = {k: np.concatenate([getattr(v, k) for v in seen]) for k in ("wi", "wo", "f", "sigma", "saturated")}
    good = np.isfinite(parts["f"]).all(1)
    spent = float(sum(v.rig_s.sum() for v in seen))
    poses = np.array([raw["pose_rad"] for v in seen for raw in v.raw if raw])
    plan_s = planned(rig_config, poses) if len(poses) else 0.0  # an ideal rig has no poses
    return spent, plan_s, Samples.of(**{k: a[good] for k, a in parts.items()})


def planned(rig: RigConfig, poses: Array) -> float:
    """Seconds from the pose of rest through poses (M, A): straight travel, settling, one exposure each."""
    axes = axes_of(rig)
    velocity, acceleration = (np.array([getattr(a, k) for a in axes]) for k in ("velocity", "acceleration"))
    travel = move_time(np.diff(poses, axis=0, prepend=park_pose(rig)[None]), velocity, acceleration)
    return float(travel.sum()) + len(poses) * (rig.settle_s + rig.exposure_s)


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
            _stairs(material, rig, (name, block) == (config.materials[0], config.blocks[0]), say)


def _stairs(material: Material, rig: RigConfig, asides: bool, say: Callable[[str], None]) -> None:
    truth = truth_of(material.truth or material.name)
    batches = asked(material, truth, rig)
    n, isotropic = sum(len(wi) for wi, *_ in batches), material.symmetry == "isotropic"
    say(f"{material.name}: {n} measurements, blocks of {material.sampler.block}, rig {rig.name}")
    say(f"{'':36}{'rig h':>8}{'s each':>8}{'fewer':>8}{'wall/plan':>11}{'energy':>8}{'CPU s':>8}")
    before = None
    for name, switches, backlash in [*[(*stair, 0.0) for stair in STAIRS], *(ASIDES if asides else ())]:
        axes = {k: a.model_copy(update={"backlash_deg": backlash}) for k, a in rig.axes.items()}
        began = time.process_time()
        this = rig.model_copy(update={"axes": axes})
        spent, plan_s, samples = drive(batches, truth, this, PlanConfig(**switches), isotropic)
        cpu = time.process_time() - began
        before = before or spent
        energy = evaluate(reconstruct(samples, anisotropic=not isotropic), truth)["energy_median"]
        say(
            f"{name:36}{spent / 3600:8.2f}{spent / n:8.3f}{before / spent:7.2f}x{spent / plan_s:11.4f}"
            f"{energy:8.3f}{cpu:8.1f}"
        )
