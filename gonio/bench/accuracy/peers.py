"""Error against measurements, rig seconds and CPU seconds: ours beside every other way to measure a material.

    gonio bench accuracy

A cell is one way of looking at one material, on the same rig with the same noise and clock, by gonio's motion or by
straight travel in the way's own order; what it read is reconstructed by each of `models` (`own`: as the way's source
does it). Rig seconds and measurements to an error are read off between the budgets, on logarithms.
"""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gonio.bench.accuracy.peer_tables import say_tables
from gonio.bench.drive import truth_of
from gonio.bench.harness import Cell, Row, run_cells
from gonio.bench.harness.plots import error_figure
from gonio.bench.harness.results import write_parquet
from gonio.bench.peers import PEERS, peer
from gonio.bench.peers.session import STRAIGHT, Session
from gonio.brdf import Brdf
from gonio.config import ConfigError, load_config
from gonio.config.find import find_config
from gonio.config.loader import Section
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.evaluate import evaluate
from gonio.reconstruct import ReconstructionError, reconstruct


class Config(Section):
    """ways: of gonio.bench.peers. motion: `ours` plans tours and poses for everybody, `own` for nobody. most: of a way,
    the largest budget that it is asked for. straight: budgets that are measured by `own` motion too."""

    study: Literal["accuracy"]
    materials: tuple[str, ...]
    ways: tuple[str, ...] = tuple(PEERS)
    models: tuple[str, ...] = ("auto", "own")
    measurements: tuple[int, ...] = (20, 50, 100, 300, 1000, 3000)
    straight: tuple[int, ...] = (300, 1000)
    most: dict[str, int] = {}
    least: dict[str, int] = {}
    seeds: int = 1
    rig: str = "sim"
    goals: tuple[float, ...] = (0.10, 0.05)
    workers: int = 2
    dask: str | None = None


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    if unknown := set(config.ways) - set(PEERS):
        raise ConfigError(f"ways: {', '.join(sorted(unknown))} is not one of {', '.join(PEERS)}")
    rows: list[Row] = []
    made = run_cells(f"{__name__}:cell", cells(config), out, workers=config.workers, dask=config.dask)
    try:
        for _, found in made:
            rows += found
    finally:
        if rows:
            write_parquet(out / "results.parquet", rows, config)
            good = [r for r in rows if r.get("energy") is not None]
            say_tables(good, config.goals, say)
            error_figure(good, out / "error.png")


def cells(config: Config) -> Iterator[Cell]:
    """Small budgets first, so that a study that is stopped has a table; straight travel last."""
    for motion, budgets in (("ours", config.measurements), ("own", config.straight)):
        for n in budgets:
            for way in config.ways:
                if not config.least.get(way, 0) <= n <= config.most.get(way, n):
                    continue
                models = [m for m in config.models if m != "own" or hasattr(peer(way), "own")]
                for material in config.materials:
                    for seed in range(1, config.seeds + 1):
                        yield {
                            "material": material, "way": way, "n": n, "motion": motion, "seed": seed,
                            "rig": config.rig, "models": models,
                        }  # fmt: skip


def cell(c: dict[str, Any]) -> list[Row]:
    """One row for each model."""
    truth = truth_of(c["material"])
    rig = load_config(find_config(c["rig"], "rigs"), RigConfig)
    session = Session(c["material"], truth, rig, c["seed"], PlanConfig() if c["motion"] == "ours" else STRAIGHT)
    way = peer(c["way"])
    began = time.process_time()
    way.look(session, c["n"], np.random.default_rng([c["seed"], c["n"]]))
    looking = time.process_time() - began
    rows = []
    for model in c["models"]:
        began = time.process_time()
        row: Row = {"model": model, "measured": session.measured, "rig_s": session.rig_s}
        try:
            brdf: Brdf = way.own(session) if model == "own" else reconstruct(session.samples, model)
            row["cpu_s"] = looking + time.process_time() - began
            found = evaluate(brdf, truth)
            row |= {"energy": found["energy_mean"], "grazing": found["grazing"], "log": found["log"]}
        except ReconstructionError as e:
            row["refused"] = str(e)
        rows.append(row)
    return rows
