"""What is skipped, and what that saves: each saving on and off, with its band over seeds.

    gonio bench skips

A cell measures one material once, with everything that is the default, or with one thing switched off, or with all off.
Rig seconds, CPU seconds, measurements and the energy error are means; the band is 1.96 standard errors over seeds. What
costs more of the same measurement shows in rig seconds; what spoils it, in the error.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gonio.bench.accuracy.peer_tables import of
from gonio.bench.drive import surrogate, truth_of
from gonio.bench.harness import Cell, Row, run_cells
from gonio.bench.harness.results import geometric, say_table, write_parquet
from gonio.bench.peers.session import Session
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.loader import Section
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.evaluate import evaluate
from gonio.geometry import Array
from gonio.mcmc import make_sampler
from gonio.reconstruct import ReconstructionError, Samples, reconstruct
from gonio.reconstruct.running import fit as fit_running


@dataclass(frozen=True)
class Off:
    """A saving that is switched off: keys of the plan and of the sampler; and what no key says."""

    plan: dict[str, Any] = field(default_factory=dict)
    sampler: dict[str, Any] = field(default_factory=dict)
    asked_of_rig: bool = True  # whether the sampler knows what the rig reaches
    stops: bool = True  # whether it ends when it is good enough
    table: bool = False  # whether each look makes the table, not only what it is asked for


DEFAULT = "everything skipped (the default)"
OFF: dict[str, Off] = {
    DEFAULT: Off(),
    "proposals outside the support": Off(asked_of_rig=False),
    "equivalent poses": Off(plan={"branches": False}),
    "free azimuth, mirror images": Off(plan={"free_azimuth": False}),
    "tour": Off(plan={"tour": False}),
    "predicted ranges": Off(plan={"predict_range": False}),
    "shared darks": Off(plan={"dark_every": 1}),
    "early stop": Off(stops=False),
    "tables on demand": Off(table=True),
    "what is not known yet as the target, blocks": Off(sampler={"proposal": "pss_simple"}, stops=False),
    "learning (one fixed lobe instead)": Off(sampler={"proposal": "independence"}, stops=False),
    "all of these": Off(
        plan={"branches": False, "free_azimuth": False, "tour": False, "predict_range": False, "dark_every": 1},
        sampler={"proposal": "pss_simple"}, asked_of_rig=False, stops=False, table=True,
    ),
}  # fmt: skip
ON: dict[str, Off] = {"reciprocity (not the default)": Off(plan={"reciprocity": True})}


class Config(Section):
    """measurements: the budget; goal: the estimated error at which a run that stops by itself ends."""

    study: Literal["skips"]
    materials: tuple[str, ...]
    measurements: int = 600
    goal: float = 0.08
    seeds: int = 3
    rig: str = "sim"
    workers: int = 2
    dask: str | None = None


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    cells: list[Cell] = [
        {"skip": s, "material": m, "seed": k, "n": config.measurements, "goal": config.goal, "rig": config.rig}
        for k in range(1, config.seeds + 1) for m in config.materials for s in (*OFF, *ON)
    ]  # fmt: skip
    rows: list[Row] = []
    try:
        for _, found in run_cells(f"{__name__}:cell", cells, out, workers=config.workers, dask=config.dask):
            rows += found
    finally:
        good = [r for r in rows if "energy" in r]
        if good:
            write_parquet(out / "results.parquet", rows, config)
            _table(good, say)


def cell(c: dict[str, Any]) -> list[Row]:
    off = {**OFF, **ON}[c["skip"]]
    truth = truth_of(c["material"])
    rig = load_config(find_config(c["rig"], "rigs"), RigConfig)
    session = Session(c["material"], truth, rig, c["seed"], PlanConfig(**off.plan))
    began = time.process_time()
    wasted = _measured(session, off, c["n"], c["goal"])
    cpu = time.process_time() - began
    figures = evaluate(reconstruct(session.samples), truth)
    return [{
        "measured": session.measured, "wasted": wasted, "rig_s": session.rig_s, "cpu_s": cpu,
        "energy": figures["energy_mean"],
    }]  # fmt: skip


def _measured(session: Session, off: Off, n: int, goal: float) -> int:
    """Drive a sampler; how many of its draws the rig could not go to."""
    base = {"name": "x", "channels": session.channels, "seed": session.seed}
    material = Material.model_validate(base | {"sampler": off.sampler, "budget": {"measurements": n}})
    known: list[Any] = []

    def fit(wi: Array, wo: Array, f: Array, sigma: Array | None = None):
        try:
            if off.table:  # made, and not needed: the plan asks the running one where it is rough
                reconstruct(Samples.of(wi, wo, f, sigma))
            known[:] = [surrogate(wi, wo, f, sigma)]
        except ReconstructionError:
            return None
        return known[0]

    chain = make_sampler(material, session.reachable if off.asked_of_rig else None, fit, (n,))
    wasted, looked = 0, 64
    while session.measured < n:
        batch = chain.ask()
        ids = batch.ids[: n - session.measured]
        wi, wo = batch.wi[: len(ids)], batch.wo[: len(ids)]
        there = session.reachable(wi, wo)
        wasted += int((~there).sum())
        f = np.full((len(ids), session.channels), np.nan)
        sigma = f.copy()
        if there.any():
            read = session(wi[there], wo[there], known[0].eval if known else None)
            f[there], sigma[there] = read.f, read.sigma
        chain.tell(ids, f, sigma)
        chain.take_steps()
        if off.stops and session.measured >= looked:
            looked = int(1.25 * session.measured) + 1
            if fit_running(session.samples).energy_error_estimate <= goal:
                break
    return wasted


def _table(rows: list[Row], say: Callable[[str], None]) -> None:
    base = of(rows, skip=DEFAULT)
    table = []
    for skip in dict.fromkeys(r["skip"] for r in rows):
        mine = of(rows, skip=skip)
        pairs = [(r, b) for r in mine for b in base if (r["material"], r["seed"]) == (b["material"], b["seed"])]
        ratio = lambda key, pairs=pairs: geometric([a[key] / b[key] for a, b in pairs])
        log = np.log([a["energy"] / b["energy"] for a, b in pairs])
        band = 1.96 * float(np.std(log, ddof=1)) / np.sqrt(len(log)) if len(log) > 1 else float("nan")
        off = "" if skip in ON or skip == DEFAULT else "without: "
        table.append([off + skip, float(np.mean([r["measured"] for r in mine])),
                      float(np.mean([r["wasted"] for r in mine])), float(np.mean([r["rig_s"] for r in mine])),
                      ratio("rig_s"), ratio("cpu_s"), float(np.mean([r["energy"] for r in mine])),
                      f"{ratio('energy'):.2f} ± {band:.2f}"])  # fmt: skip
    head = ["", "measured", "wasted", "rig s", "x rig s", "x CPU s", "energy error", "x error"]
    say_table(say, head, table, "what each saving is worth: with one of them off, beside the default")
