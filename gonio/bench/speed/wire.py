"""The whole acquisition through the real drivers, against emulated devices: how fast, and how near to its own plan.

    gonio bench wire

Each row is a run as `gonio acquire` makes it: sampler, planner, drivers, run file. `steps/s` is measurements by the
clock on the wall, all work included; `visits/s` counts the time within the rig only, without the sampler's and the run
file's. `rig s` is what a rig of that speed would have taken with this machine: waits as long as they are, and all that
the machine did besides. `wall/plan` is that over straight travel from pose to pose, settling and one exposure each.
"""

import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

import gonio.run.start
from gonio.bench.speed.rig_seconds import planned
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.loader import Section
from gonio.config.rig import RigConfig
from gonio.run.open_rig import open_rig


class Row(Section):
    """One run: how much faster than life the devices live, and what is set in the material."""

    clock_scale: float = 100_000
    measurements: int
    set: tuple[str, ...] = ()


class Config(Section):
    study: Literal["wire"]
    material: str
    rows: tuple[Row, ...]


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    say(f"{'clock x':>9}{'steps':>7}{'steps/s':>9}{'visits/s':>10}{'rig s each':>12}{'wall/plan':>11}  settings")
    for row in config.rows:
        sets = [f"budget.measurements={row.measurements}", *row.set]
        material = load_config(find_config(config.material, "materials"), Material, sets)
        rig = load_config(find_config("wire", "rigs"), RigConfig, [f"clock_scale={row.clock_scale}"])
        found, n = drive(material, rig), row.measurements
        say(
            f"{row.clock_scale:9g}{n:7}{n / found.machine_s:9.0f}{n / found.visiting_s:10.0f}{found.wall_s / n:12.3f}"
            f"{found.wall_s / found.plan_s:11.4f}  {' '.join(row.set)}"
        )


@dataclass(frozen=True)
class Driven:
    """Machine seconds of a run, those of them within visits; seconds by the rig's clock, and those of its plan."""

    machine_s: float
    visiting_s: float
    wall_s: float
    plan_s: float


def drive(material: Material, config: RigConfig) -> Driven:
    folder = Path(tempfile.mkdtemp(prefix="gonio-bench-"))
    visiting = 0.0
    one = gonio.run.start.start(material, config, folder / "run")
    rig: Any = open_rig(
        config, one.truth, material.seed, plan=material.plan, isotropic=material.symmetry == "isotropic"
    )
    visit = rig.visit

    def timed(*asked):
        nonlocal visiting
        seen = visit(*asked)
        while True:
            began = time.perf_counter()
            v = next(seen, None)
            visiting += time.perf_counter() - began
            if v is None:
                return
            yield v

    rig.visit = timed
    try:
        began, rig_began = time.perf_counter(), rig.clock.now()
        one(rig=rig)
        machine, wall = time.perf_counter() - began, rig.clock.now() - rig_began
        poses = np.array([raw["pose_rad"] for raw in one.store.raw() if raw])
    finally:
        rig.close()
        one.close()
        shutil.rmtree(folder)
    return Driven(machine, visiting, wall, planned(config, poses))
