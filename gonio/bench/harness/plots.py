"""Error against measurements, rig seconds and CPU seconds: a line for each way, its 95 % band over materials' seeds."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from gonio.atomic import beside
from gonio.bench.harness.cells import Row

AXES = {"measured": "measurements", "rig_s": "rig seconds", "cpu_s": "CPU seconds"}


def error_figure(rows: Sequence[Row], path: Path) -> None:
    """Rows with way, model, motion, n, energy and the keys of AXES; geometric means over materials and seeds.

    A band is that of the mean over seeds (1.96 standard errors); with one seed there is none. The grey staircase is
    the Pareto front.
    """
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    colours = colormaps["tab20"](np.linspace(0, 1, 20))
    figure = Figure(figsize=(14, 4.8), layout="constrained")
    panels = figure.subplots(1, len(AXES), sharey=True)
    rows = [r for r in rows if r["motion"] == "ours"]
    for axes, (key, name) in zip(panels, AXES.items()):
        every = []
        for number, (way, model) in enumerate(dict.fromkeys((r["way"], r["model"]) for r in rows)):
            mine = [r for r in rows if (r["way"], r["model"]) == (way, model)]
            line = np.array([_point(mine, n, key) for n in sorted({r["n"] for r in mine})])
            every.append(line[:, :2])
            x, y, spread = line.T
            label, style = (way, "-o") if model == "auto" else (f"{way}, its own model", "--s")
            (drawn,) = axes.loglog(x, y, style, ms=3, color=colours[number % len(colours)], label=label)
            low, high = (y * np.exp(k * 1.96 * spread) for k in (-1, 1))
            axes.fill_between(x, low, high, color=drawn.get_color(), alpha=0.15)
        front = pareto(np.concatenate(every))
        axes.step(*front.T, where="post", color="0.6", lw=4, alpha=0.4, zorder=0)
        axes.set_xlabel(name)
        axes.grid(alpha=0.3, which="both")
    panels[0].set_ylabel("energy error")
    panels[-1].legend(fontsize="x-small", loc="upper left", bbox_to_anchor=(1, 1))
    with beside(path) as part:
        figure.savefig(part, dpi=130)


def _point(rows: Sequence[Row], n: int, key: str) -> tuple[float, float, float]:
    """Geometric means of key and error of a budget, and the standard error of the error's logarithm over seeds."""
    some = [r for r in rows if r["n"] == n]
    by_seed = [np.mean(np.log([r["energy"] for r in some if r["seed"] == s])) for s in {r["seed"] for r in some}]
    spread = np.std(by_seed, ddof=1) / np.sqrt(len(by_seed)) if len(by_seed) > 1 else 0.0
    return np.exp(np.mean(np.log([max(r[key], 1e-9) for r in some]))), np.exp(np.mean(by_seed)), spread


def pareto(points: np.ndarray) -> np.ndarray:
    """Of points (N, 2), cost and error, those that no other undercuts in both, by rising cost."""
    ordered = points[np.lexsort(points.T[::-1])]
    best = np.minimum.accumulate(ordered[:, 1])
    return ordered[np.concatenate([[True], best[1:] < best[:-1]])]
