"""Do the numbers hold? Functions against 50 digits, and whole runs of every kind.

    gonio bench stability

`functions`: every public function of gonio.bench.stability.cases over alpha 1e-4 … 1 and theta to 89.999 degrees, with
float64 and float32 inputs; a heat map for each. `runs`: end-to-end runs with random materials, configs, noise, worlds
and faults; what ends in a number that is none, a traceback or not at all is counted.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.atomic import beside
from gonio.bench.harness import Row, run_cells
from gonio.bench.harness.results import say_table, write_parquet
from gonio.bench.stability import runs as whole_runs
from gonio.bench.stability import sweep
from gonio.config.loader import Section


class Config(Section):
    """random: inputs of each function; search: generations of the search for its worst case; map: sides of the maps;
    runs: whole runs."""

    study: Literal["stability"]
    random: int = 1_000_000
    search: int = 40
    map: int = 24
    runs: int = 1000
    workers: int = 2
    dask: str | None = None


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    cells = sweep.cells(config.random, config.search, config.map)
    made = run_cells(f"{sweep.__name__}:cell", cells, out, workers=config.workers, dask=config.dask)
    rows = [r for _, found in made for r in found]
    if rows:
        rows.sort(key=lambda r: (r["function"], r["numbers"] != "float64"))
        write_parquet(out / "functions.parquet", rows, config)
        table = [[r["function"], r["numbers"], r["worst_random"], r["worst_search"], r["domain"]] for r in rows]
        say_table(say, ["function", "inputs", "worst of random", "worst found", "domain"], table,
                  f"relative error against 50 digits, {config.random:,} inputs each")  # fmt: skip
        _maps(rows, out / "maps.png")
    if config.runs:
        _whole(config, out, say)


def _whole(config: Config, out: Path, say: Callable[[str], None]) -> None:
    ends: list[Row] = []
    cells = ({"run": k} for k in range(config.runs))
    made = run_cells(f"{whole_runs.__name__}:cell", cells, out, workers=config.workers, dask=config.dask)
    try:
        for _, found in made:
            ends += found
    finally:
        if ends:
            write_parquet(out / "runs.parquet", ends, config)
            counts = Counter(r.get("end", "failed") for r in ends)
            say("")
            say(f"{len(ends)} whole runs: " + ", ".join(f"{n} {e}" for e, n in counts.most_common()))
            for r in ends:
                if r.get("end") not in whole_runs.GOOD:
                    say(f"  run {r['run']}: {r.get('end', 'failed')}: {r.get('why', r.get('failed', ''))}")


def _maps(rows: Sequence[Row], path: Path) -> None:
    """log10 of the relative error over alpha and theta_i, float64 inputs."""
    from matplotlib.figure import Figure

    rows = [r for r in rows if r["numbers"] == "float64"]
    columns = 5
    figure = Figure(figsize=(3.2 * columns, 2.9 * -(-len(rows) // columns)), layout="constrained")
    panels = figure.subplots(-(-len(rows) // columns), columns, squeeze=False).ravel()
    for axes in panels[len(rows) :]:
        axes.set_axis_off()
    for axes, r in zip(panels, rows):
        shown = axes.imshow(
            np.array(r["table"]), origin="lower", extent=(-4, 0, 0.5, 90), aspect="auto", vmin=-17, vmax=-8
        )
        axes.set_title(r["function"], fontsize=9)
    panels[0].set_ylabel("theta_i [deg]")
    panels[0].set_xlabel("log10 alpha")
    figure.colorbar(shown, ax=panels.tolist(), label="log10 relative error", shrink=0.6)
    with beside(path) as part:
        figure.savefig(part, format="png", dpi=110)
