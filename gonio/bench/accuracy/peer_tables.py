"""Tables of the study of peers: mean errors by budget, and what an error costs each way."""

from collections.abc import Callable, Sequence

import numpy as np

from gonio.bench.harness import Row
from gonio.bench.harness.results import geometric, say_table

OURS = "ours"


def say_tables(rows: Sequence[Row], goals: Sequence[float], say: Callable[[str], None]) -> None:
    ours, own = of(rows, motion="ours"), of(rows, motion="own")
    for some, title in ((ours, "gonio's motion for everybody"), (own, "each in its own order, straight travel")):
        if some:
            _by_budget(some, title, say)
    if ours:
        _costs(ours, own, goals, say)


def lines_of(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """way, model: ours first, then in the order of the rows."""
    found = list(dict.fromkeys((r["way"], r["model"]) for r in rows))
    return sorted(found, key=lambda k: k[0] != OURS)


def of(rows: Sequence[Row], **keys) -> list[Row]:
    return [r for r in rows if all(r[k] == v for k, v in keys.items())]


def _by_budget(rows: Sequence[Row], title: str, say: Callable[[str], None]) -> None:
    """Mean over materials and seeds of the energy error, the worst in brackets, rig seconds each."""
    budgets = sorted({r["n"] for r in rows})
    table = []
    for way, model in lines_of(rows):
        line: list = [way, model]
        for n in budgets:
            some = of(rows, way=way, model=model, n=n)
            energy = [r["energy"] for r in some]
            line.append(f"{np.mean(energy):.4f} ({np.max(energy):.2f})" if some else "")
        last = of(rows, way=way, model=model, n=max(r["n"] for r in of(rows, way=way, model=model)))
        line.append(float(np.mean([r["rig_s"] / r["measured"] for r in last])))
        table.append(line)
    say_table(say, ["way", "model", *(f"N = {n}" for n in budgets), "rig s each"], table, f"energy error, {title}")


def _costs(ours: Sequence[Row], own: Sequence[Row], goals: Sequence[float], say: Callable[[str], None]) -> None:
    """What an error costs, ours over each: geometric means over the materials that both reach."""
    for key, name in (("rig_s", "rig seconds"), ("measured", "measurements")):
        for rows, motion in ((ours, "gonio's motion"), (own, "their own")):
            if not rows:
                continue
            table = []
            for way, model in lines_of(rows):
                line: list = [way, model]
                for goal in goals:
                    materials = dict.fromkeys(r["material"] for r in rows)
                    ratios = []
                    for m in materials:
                        mine = reached(of(ours, way=OURS, model="auto", material=m), goal, key)
                        theirs = reached(of(rows, way=way, model=model, material=m), goal, key)
                        ratios += [theirs / mine] if mine and theirs else []
                    share = f"{len(ratios)} of {len(materials)}"
                    line.append(f"{geometric(ratios):.2f} ({share})" if ratios else "not reached")
                table.append(line)
            say_table(say, ["way", "model", *(f"to {g:g}" for g in goals)], table,
                      f"{name} to an energy error, of ours 1; {motion}; materials that both reach")  # fmt: skip


def reached(rows: Sequence[Row], goal: float, key: str) -> float | None:
    """What `key` is where the error falls to `goal`: between budgets on logarithms, by the first two or last two
    beyond them; at most a factor 3 beyond; None where that does not reach it."""
    budgets = sorted({r["n"] for r in rows})
    if len(budgets) < 2:
        return None
    mean = lambda k: np.log([np.exp(np.mean(np.log([r[k] for r in rows if r["n"] == n]))) for n in budgets])
    x, y = mean(key), mean("energy")
    below = np.flatnonzero(y <= np.log(goal))
    k = max(int(below[0]), 1) if len(below) else len(y) - 1
    slope = (y[k] - y[k - 1]) / (x[k] - x[k - 1])
    if slope >= 0:
        return float(np.exp(x[k])) if len(below) else None
    at = x[k] + (np.log(goal) - y[k]) / slope
    return float(np.exp(at)) if x[0] - np.log(3) <= at <= x[-1] + np.log(3) else None
