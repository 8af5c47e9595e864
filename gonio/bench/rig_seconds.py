"""What each saving of motion is worth: the same measurements driven with the switches of `plan` on and off.

    python -m gonio.bench.rig_seconds [MATERIAL] [--measurements N] [--set sampler.block=512]

The measurements are those that the material's own sampler asks for on the rig's reachable set, batch by batch. They are
driven by the simulated rig of depth `devices` as its YAML has it, noise included; `energy` is the energy error of the
default reconstruction from what was read, so that a saving that costs accuracy shows.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

from gonio.brdf import Brdf
from gonio.config import Material, load_config
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.evaluate import evaluate
from gonio.geometry import Array
from gonio.load import load_brdf
from gonio.mcmc import make_sampler
from gonio.reconstruct import Samples, reconstruct
from gonio.rigs import open_rig

Batches = list[tuple[Array, Array]]
ROOT = Path(__file__).resolve().parents[2]

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
    sampler = make_sampler(material, open_rig(rig, truth, 0).reachable)
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


def main(argv: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(prog="python -m gonio.bench.rig_seconds")
    parser.add_argument("material", nargs="?", default="chm_orange")
    parser.add_argument("--measurements", type=int, default=10_000)
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    options = parser.parse_args(argv)
    path = ROOT / "configs/materials" / f"{options.material}.yaml"
    material = load_config(path, Material, [f"budget.measurements={options.measurements}", *options.set])
    rig = load_config(ROOT / "configs/rigs/sim.yaml", RigConfig)
    truth = load_brdf(material.truth or material.name)
    batches = asked(material, truth, rig)
    print(f"{options.material}: {options.measurements} measurements in {len(batches)} batches, rig {rig.name}")
    print(f"{'':36}{'rig h':>8}{'s each':>8}{'fewer':>8}{'energy':>8}{'CPU s':>8}")
    before = None
    for name, switches in STAIRS:
        began = time.process_time()
        spent, samples = drive(batches, truth, rig, PlanConfig(**switches), material.symmetry == "isotropic")
        cpu = time.process_time() - began
        before = before or spent
        energy = evaluate(reconstruct(samples, anisotropic=material.symmetry == "anisotropic"), truth)["energy_median"]
        each = spent / options.measurements
        print(f"{name:36}{spent / 3600:8.2f}{each:8.3f}{before / spent:7.2f}x{energy:8.3f}{cpu:8.1f}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
