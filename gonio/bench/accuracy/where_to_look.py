"""Where to look: the default, the chain of before and a list that knows nothing, by number and by rig seconds.

    gonio bench where_to_look

Every way chooses N directions for every material; the rig measures them, with noise and travel (without by
`--set rig=ideal`), and they are reconstructed alike. `unknown`, `energy`: targets of `sampler.target.kind`; `list`
is a scrambled Sobol sequence in (theta_h = pi/2 u^2, theta_d, phi_d), toured as a whole. At equal rig seconds the list
has as many measurements as fit into the time that `unknown` took.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.atomic import write_text
from gonio.bench.drive import truth_of
from gonio.bench.speed.rig_seconds import asked, drive
from gonio.brdf import Brdf
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.loader import Section
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.evaluate import evaluate
from gonio.geometry import Array, from_half_diff
from gonio.reconstruct import reconstruct
from gonio.run.open_rig import open_rig

WAYS = ("unknown", "energy", "list", "list, same time")


class Config(Section):
    """materials and the counts N of measurements; rig: as in configs/rigs; seeds averaged."""

    study: Literal["where_to_look"]
    materials: tuple[str, ...]
    measurements: tuple[int, ...] = (300, 1000, 3000)
    rig: str = "sim"
    seeds: tuple[int, ...] = (1,)


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    rig = load_config(find_config(config.rig, "rigs"), RigConfig)
    say(f"{'material':24}{'N':>7}" + "".join(f"{way:>18}{'s each':>8}" for way in WAYS))
    rows = []
    for name in config.materials:
        truth = truth_of(name)
        for n in config.measurements:
            found = np.mean([_compare(truth, rig, n, seed) for seed in config.seeds], axis=0)
            rows.append({"material": name, "n": n, "energy": found[:, 0].tolist(), "seconds": found[:, 1].tolist()})
            say(f"{name:24}{n:7}" + "".join(f"{energy:18.4f}{s:8.3f}" for energy, s in found))
            write_text(out / "rows.json", json.dumps(rows, indent=1))
    say("")
    for n in config.measurements:
        energy = np.array([r["energy"] for r in rows if r["n"] == n])
        geometric = np.exp(np.log(energy).mean(0))
        mean = "  ".join(f"{way} {m:.4f}" for way, m in zip(WAYS, energy.mean(0)))
        ratios = [geometric[0] / geometric[2], geometric[0] / geometric[3], geometric[0] / geometric[1]]
        say(f"N = {n}: mean energy  {mean}")
        say(
            f"  geometric: unknown / list {ratios[0]:.2f}, at equal rig seconds {ratios[1]:.2f}; "
            f"unknown / energy {ratios[2]:.2f}"
        )


def _compare(truth: Brdf, rig: RigConfig, n: int, seed: int) -> list[tuple[float, float]]:
    """Energy error and rig seconds per measurement of each of WAYS."""
    reachable = open_rig(rig, truth, 0).reachable
    found = []
    for kind in ("unknown", "energy"):
        section = {"target": {"kind": kind}}
        material = Material.model_validate(
            {"name": "x", "channels": truth.channels, "seed": seed, "sampler": section, "budget": {"measurements": n}}
        )
        found.append(_judged(asked(material, truth, rig), truth, rig))
    wi, wo = sobol_list(4 * n, seed, reachable)
    listed = _judged([(wi[:n], wo[:n], None)], truth, rig)
    # as many as fit into the time of `unknown`; an ideal rig takes none
    count = int(n * found[0][1] / listed[1]) if listed[1] > 0 else n
    return [*found, listed, _judged([(wi[:count], wo[:count], None)], truth, rig)]


def _judged(batches, truth: Brdf, rig: RigConfig) -> tuple[float, float]:
    spent, _, samples = drive(batches, truth, rig, PlanConfig(), True)
    return evaluate(reconstruct(samples), truth)["energy_mean"], spent / sum(len(wi) for wi, *_ in batches)


def sobol_list(count: int, seed: int, reachable: Callable[[Array, Array], Array]) -> tuple[Array, Array]:
    """wi, wo (N, 3) of a list of `count` that the rig reaches."""
    from scipy.stats import qmc

    u = qmc.Sobol(3, seed=seed).random(2 ** int(np.ceil(np.log2(count))))
    wi, wo = from_half_diff(np.pi / 2 * u[:, 0] ** 2, 0 * u[:, 0], np.pi / 2 * u[:, 1], 2 * np.pi * u[:, 2])
    keep = (np.minimum(wi[:, 2], wo[:, 2]) > 1e-3) & reachable(wi, wo)
    return wi[keep], wo[keep]
