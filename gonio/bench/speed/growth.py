"""How time and memory grow with measurements, chains, channels and tables; and the loop's CPU beside the rig.

    gonio bench growth

A cell does one thing at one size and takes its CPU seconds and the peak of its allocations. Exponents are fitted to the
upper half of the sizes, on logarithms. CPU per measurement of a whole run is set against the rig seconds it controls.
"""

import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from gonio.atomic import beside
from gonio.bench.drive import surrogate, truth_of
from gonio.bench.harness import Cell, Row, run_cells
from gonio.bench.harness.results import say_table, write_parquet
from gonio.brdf import Ggx, Lambert
from gonio.brdf.models.mixture import Mixture
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.loader import Section
from gonio.config.rig import RigConfig
from gonio.export.bsdf import fields
from gonio.geometry import from_height
from gonio.mcmc import make_sampler
from gonio.reconstruct import Samples, reconstruct

GOAL, SHARE = 1.1, 0.02


class Config(Section):
    """Sizes along each axis; loops: rig -> measurements of the whole runs."""

    study: Literal["growth"]
    material: str = "cc_ibiza_sunset"
    measurements: tuple[int, ...] = (100, 1000, 10_000, 100_000, 1_000_000)
    chains: tuple[int, ...] = (1, 4, 16, 64, 256, 1024, 4096)
    channels: tuple[int, ...] = (1, 3, 10, 30, 100, 200)
    tables: tuple[int, ...] = (16, 32, 64, 128)
    loops: dict[str, int] = {"sim": 2000, "wire": 60}
    workers: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    sizes = {
        "reconstruct": config.measurements,
        "steps": config.chains,
        "spectrum": config.channels,
        "table": config.tables,
    }
    cells: list[Cell] = [{"what": w, "size": n, "material": config.material} for w, all_ in sizes.items() for n in all_]
    cells += [{"what": f"loop on {rig}", "size": n, "material": config.material} for rig, n in config.loops.items()]
    rows: list[Row] = []
    try:
        for _, found in run_cells(f"{__name__}:cell", cells, out, workers=config.workers):
            rows += found
    finally:
        if rows:
            write_parquet(out / "results.parquet", rows, config)
            _tables(rows, say)
            _plot(rows, out / "growth.png")


def cell(c: dict[str, Any]) -> list[Row]:
    if c["what"].startswith("loop on "):
        return [_loop(c["what"].removeprefix("loop on "), c["size"], c["material"])]
    work = {"reconstruct": _reconstruct, "steps": _steps, "spectrum": _spectrum, "table": _table}[c["what"]]
    do = work(c["size"], c["material"])
    began = time.process_time()
    do()
    cpu = time.process_time() - began
    tracemalloc.start()  # a second time: watching allocations costs time
    do()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return [{"cpu_s": cpu, "memory_mb": peak / 1e6}]


def _samples(count: int, truth) -> Samples:
    """By the truth's own sampler, a quarter even over the hemisphere, with the rig's noise."""
    rng = np.random.default_rng(1)
    wi = from_height(rng.random(2 * count + 64), 0 * rng.random(2 * count + 64))
    wo, _ = truth.sample(wi, rng.random((len(wi), 2)))
    even = from_height(rng.random(len(wi)), 2 * np.pi * rng.random(len(wi)))
    wo = np.where((rng.random(len(wi)) < 0.25)[:, None], even, wo)
    keep = np.flatnonzero((wo[:, 2] > 1e-3) & (wi[:, 2] > 1e-3))[:count]
    f = truth.eval(wi[keep], wo[keep])
    sigma = np.hypot(0.005 * f, 3.2e-5 / wi[keep, 2:])
    return Samples.of(wi[keep], wo[keep], f + sigma * rng.standard_normal(f.shape), sigma)


def _reconstruct(count: int, material: str) -> Callable[[], Any]:
    s = _samples(count, truth_of(material))
    return lambda: reconstruct(s)


def _spectrum(channels: int, material: str) -> Callable[[], Any]:
    colour = 0.2 + 0.6 * np.linspace(0, 1, channels)
    s = _samples(1000, Mixture([Lambert(0.3 * colour), Ggx(0.1, None, colour)]))
    return lambda: reconstruct(s)


def _steps(chains: int, material: str) -> Callable[[], Any]:
    """Rounds of a random walk, as many steps for every count of chains as 4,096 make in four."""
    brdf = Mixture([Lambert([0.2]), Ggx(0.3, None, [0.5])])
    section = {"proposal": "pss_simple", "chains": chains}
    config = Material.model_validate({"name": "x", "channels": 1, "sampler": section})

    def do() -> None:
        sampler = make_sampler(config, None, surrogate)
        for _ in range(8):
            batch = sampler.ask()
            sampler.tell(batch.ids, brdf.eval(batch.wi, batch.wo))

    return do


def _table(resolution: int, material: str) -> Callable[[], Any]:
    """A `.bsdf` of 32 incidences of so many nodes squared."""
    brdf = Mixture([Lambert([0.2] * 3), Ggx(0.1, None, [0.5] * 3)])
    return lambda: fields(brdf, False, False, 32, resolution)


def _loop(rig: str, count: int, material: str) -> Row:
    """CPU of this process, children included, beside the rig seconds of a whole run."""
    import os

    from gonio.run.start import start

    truth = truth_of(material)
    base = {"name": "x", "truth": material, "channels": truth.channels, "budget": {"measurements": count}}
    with TemporaryDirectory() as scratch:
        run_ = start(
            Material.model_validate(base), load_config(find_config(rig, "rigs"), RigConfig), Path(scratch) / "run"
        )
        before = sum(os.times()[:4])
        run_()
        cpu = sum(os.times()[:4]) - before
        rig_s = float(run_.store.measured().rig_s.sum())
        run_.close()
    return {"cpu_s": cpu, "rig_s": rig_s}


SIZE_OF = {"reconstruct": "measurements", "steps": "chains", "spectrum": "channels", "table": "nodes a side"}


def exponent(sizes: np.ndarray, values: np.ndarray) -> float:
    """Of the upper half of the sizes, at least two."""
    k = min(len(sizes) // 2, len(sizes) - 2)
    return float(np.polyfit(np.log(sizes[k:]), np.log(np.maximum(values[k:], 1e-9)), 1)[0])


def _tables(rows: list[Row], say: Callable[[str], None]) -> None:
    table = []
    for what, name in SIZE_OF.items():
        mine = sorted((r for r in rows if r["what"] == what and "cpu_s" in r), key=lambda r: r["size"])
        if len(mine) < 2:
            continue
        size, cpu, memory = (np.array([r[k] for r in mine], float) for k in ("size", "cpu_s", "memory_mb"))
        per = 2 if what == "table" else 1  # a table has resolution^2 nodes
        ends = f"{name} {size[0]:g} … {size[-1]:g}", float(cpu[0]), float(cpu[-1])
        table.append([what, *ends, exponent(size, cpu) / per, float(memory[-1]), exponent(size, memory) / per])
    head = ["what", "of", "CPU s, first", "last", "exponent", "MB, last", "exponent "]
    say_table(say, head, table, f"growth (goal: exponents of at most {GOAL}; of a table, by its nodes)")
    loops = [[r["what"], r["size"], 1e3 * r["cpu_s"] / r["size"], r["rig_s"] / r["size"], r["cpu_s"] / r["rig_s"]]
             for r in rows if "rig_s" in r]  # fmt: skip
    say_table(say, ["whole loop", "measurements", "CPU ms each", "rig s each", "share"], loops,
              f"CPU beside the rig seconds that it controls (goal: {SHARE:.0%})")  # fmt: skip


def _plot(rows: list[Row], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14, 3.6), layout="constrained")
    for axes, (what, name) in zip(figure.subplots(1, len(SIZE_OF)), SIZE_OF.items()):
        mine = sorted((r for r in rows if r["what"] == what and "cpu_s" in r), key=lambda r: r["size"])
        for key, label in (("cpu_s", "CPU s"), ("memory_mb", "MB")):
            axes.loglog([r["size"] for r in mine], [max(r[key], 1e-4) for r in mine], "-o", ms=3, label=label)
        axes.set_title(what)
        axes.set_xlabel(name)
        axes.grid(alpha=0.3)
        axes.legend()
    with beside(path) as part:
        figure.savefig(part, format="png", dpi=110)
