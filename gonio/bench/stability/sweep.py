"""How far off public functions are: over a map, a million inputs, and where a search for the worst case leads.

Relative errors against 50 digits (mpmath). A million random inputs are compared in extended precision first, the worst
of them then in 50 digits. The search is scipy's differential evolution on the logarithm of the error.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from gonio.bench.harness import Row
from gonio.bench.stability.cases import CASES, Case, Inputs
from gonio.bench.stability.exact import Extended, normalised
from gonio.geometry import Array

DIGITS = 50
LOW = np.array([np.log(1e-4), 0.0, 0.0, 0.0, 0.0, 0.0])
HIGH = np.array([0.0, np.radians(89.999), np.radians(89.999), np.pi, 1.0, 1.0])
TINY = 1e-300


def errors(case: Case, x: Inputs, numbers: str = "mpmath") -> Array:
    """Relative errors (N,) of a case at inputs; inf where ours is not finite, 0 outside of its domain."""
    with np.errstate(all="ignore"):
        ours = case.ours(x)
    right = _extended(case, x) if numbers == "extended" else _mpmath(case, x)
    with np.errstate(all="ignore"):
        off = np.abs(ours.astype(right.dtype) - right) / np.maximum(np.abs(right), TINY)
    off = np.where(np.isfinite(ours), off, np.inf).astype(float)
    return np.where(case.inside(x), off, 0.0)


def _extended(case: Case, x: Inputs) -> Array:
    m = Extended()
    wide = lambda a: a.astype(np.longdouble)
    wi, wo = (normalised(m, tuple(wide(w).T)) for w in (x.wi, x.wo))
    with np.errstate(all="ignore"):
        return case.right(m, wide(x.alpha), wi, wo, wide(x.u), wide(x.v))


def _mpmath(case: Case, x: Inputs) -> Array:
    import mpmath as m

    m.mp.dps = DIGITS
    number = lambda a: m.mpf(float(a))
    out = np.empty(len(x), np.longdouble)
    for k in range(len(x)):
        wi, wo = (normalised(m, tuple(map(number, w[k]))) for w in (x.wi, x.wo))
        value = case.right(m, number(x.alpha[k]), wi, wo, number(x.u[k]), number(x.v[k]))
        out[k] = np.longdouble(m.nstr(value, 25))
    return out


def adversarial(rng: np.random.Generator, count: int) -> Array:
    """Columns (count, 6): a third even over everything, a third near the mirror direction, at distances of every
    magnitude, a third near poles, the horizon and each other."""
    c = LOW + (HIGH - LOW) * rng.random((count, 6))
    c[:, 0] = np.exp(c[:, 0])
    near = 10.0 ** rng.uniform(-9, 0, (count, 3)) * rng.choice([-1, 1], (count, 3))
    mirror, edge = np.arange(count) % 3 == 1, np.arange(count) % 3 == 2
    c[mirror, 2] = c[mirror, 1] + near[mirror, 0]
    c[mirror, 3] = np.pi - np.abs(near[mirror, 1])
    at = rng.choice([0.0, np.pi / 2 - np.radians(0.001)], (count, 2))
    c[edge, 1:3] = at[edge] + np.where(at[edge] > 0, -1, 1) * np.abs(near[edge, :2])
    c[edge, 3] = rng.choice([0.0, np.pi / 2, np.pi], count)[edge] + near[edge, 2]
    c[:, 1:3] = np.clip(np.abs(c[:, 1:3]), 0, HIGH[1])
    c[edge, 4] = np.abs(near[edge, 0])
    return c


def cells(random: int, search: int, map_side: int) -> Iterator[dict[str, Any]]:
    for case in CASES:
        for dtype in ("float64", "float32"):
            yield {"function": case.name, "numbers": dtype, "random": random, "search": search, "map": map_side}


def cell(c: dict[str, Any]) -> list[Row]:
    """One row: errors of a function; and its map, theta by row, alpha by column."""
    case = next(k for k in CASES if k.name == c["function"])
    dtype = np.dtype(c["numbers"]).type
    rng = np.random.default_rng(1)
    columns = adversarial(rng, c["random"])
    worst_random = 0.0
    for part in np.array_split(columns, max(1, len(columns) // 50_000)):
        x = Inputs.of(part, dtype)
        if case.extended:
            off = errors(case, x, "extended")
            x = x[np.argsort(-off)[:20]]
        else:
            x = x[:500]
        worst_random = max(worst_random, float(errors(case, x).max(initial=0)))
    found, at = _search(case, dtype, c["search"])
    table = _map(case, dtype, c["map"])
    return [{
        "worst_random": worst_random, "worst_search": found, "at": at, "domain": case.domain,
        "worst": max(worst_random, found, float(np.max(table))), "table": np.log10(np.maximum(table, 1e-18)).tolist(),
    }]  # fmt: skip


def _search(case: Case, dtype: type, iterations: int) -> tuple[float, str]:
    from scipy.optimize import differential_evolution

    best: list[Any] = [0.0, None]

    def loss(c: Array) -> float:
        columns = np.array([np.exp(c[0]), *c[1:]])
        off = float(errors(case, Inputs.of(columns[None], dtype))[0])
        if off > best[0]:
            best[:] = off, columns
        return -np.log(max(off, 1e-20))

    bounds = list(zip(LOW, HIGH))
    differential_evolution(loss, bounds, maxiter=iterations, popsize=8, seed=1, polish=False, tol=0)
    names = ("alpha", "theta_i", "theta_o", "phi", "u", "v")
    return best[0], "" if best[1] is None else " ".join(f"{n}={v:.6g}" for n, v in zip(names, best[1]))


def _map(case: Case, dtype: type, side: int) -> Array:
    """(side, side): the worst of a few pairs at theta_i, down the rows, and alpha."""
    alpha = np.geomspace(1e-4, 1, side)
    theta = np.radians(np.linspace(0.5, 89.999, side))
    rows = []
    for t in theta:
        for a in alpha:
            beside = np.arctan(a * np.array([1e-3, 0.3, 3.0]))  # from the mirror direction, in widths of the lobe
            for b in beside:
                rows.append([a, t, abs(t - 2 * b) if t > 0.9 else min(t + 2 * b, HIGH[2]), np.pi, t / HIGH[1], 0.5])
    off = errors(case, Inputs.of(np.array(rows), dtype))
    return off.reshape(side, side, 3).max(-1)
