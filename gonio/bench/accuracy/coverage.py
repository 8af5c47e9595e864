"""Whether stated uncertainties are true: rigs with hidden errors, calibrated by their own commands, then runs.

    gonio bench coverage

For each seed a rig is drawn whose errors nobody is told (`world`), and a reference whose true f differs from its
certificate by what that says (k = 1). Mirror and reference calibrate it; then it measures materials. Written down: how
often truth lies within the intervals of 68, 95 and 99 % of f by stratum, of reflectance (DHR), and within 3 sigma of
each calibrated parameter; beside it the interval score (Gneiting & Raftery 2007), so that wide bars do not win. A rig
is a cell of its own, kept in `cells/`: a study that was killed goes on.
"""

import json
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gonio.atomic import write_text
from gonio.bench.accuracy.calibrated_rig import calibrated, hidden
from gonio.bench.drive import truth_of
from gonio.budget import budget_of
from gonio.budget.budget import nodes
from gonio.budget.strata import STRATA, strata
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.loader import Section
from gonio.config.rig import RigConfig
from gonio.evaluate import THETA_I, directions, evaluate
from gonio.load import load_brdf
from gonio.run.products import make_brdf
from gonio.run.start import start

DARK = 1e-6  # of the brightest f
LEVELS = (0.68, 0.95, 0.99)


class Config(Section):
    """rig: one with a `world`, whose seed is replaced by each of `seeds`; the first `runs` of them measure each
    material, measurements each. certificate_u: of the reference, relative. perfect: rig to compare with."""

    study: Literal["coverage"]
    rig: str = "uncalibrated"
    perfect: str = "sim"
    seeds: int = 50
    runs: int = 50
    materials: tuple[str, ...] = ("paper_white", "chm_orange", "cc_ibiza_sunset")
    measurements: int = 1000
    certificate_u: float = 0.003
    workers: int = 2


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    (out / "cells").mkdir(exist_ok=True)
    cells = [(config, out, seed) for seed in range(1, config.seeds + 1)]
    rows = []
    with ProcessPoolExecutor(config.workers) as pool:
        for row in pool.map(_cell, cells):
            rows.append(row)
            g = row["geometry"]
            say(
                f"rig {row['seed']:3}  {g['before_rms']:.2f} deg before, {g['rms']:.3f} after (worst {g['worst']:.3f}, "
                f"said {g['said']:.3f}), {row['rig_minutes']:.0f} rig min"
                + "".join(f"  {m} {r['energy']:.3f}" for m, r in row["runs"].items())
            )
    write_text(out / "rows.json", json.dumps(rows))
    _calibrations(rows, say)
    for name in config.materials:
        found = [r["runs"][name] for r in rows if name in r["runs"]]
        if found:
            _material(name, found, say)


def _cell(task: tuple[Config, Path, int]) -> dict[str, Any]:
    """One rig, or what is known of it from before."""
    config, out, seed = task
    kept = out / "cells" / f"{seed}.json"
    if kept.exists():
        return json.loads(kept.read_text())
    base = load_config(find_config(config.rig, "rigs"), RigConfig)
    rig, found = calibrated(hidden(base, seed), seed, config.certificate_u, out / "cells" / str(seed))
    row = {"seed": seed, **found, "runs": {}}
    if seed <= config.runs:
        for name in config.materials:
            row["runs"][name] = _measured(name, rig, config, seed, out / "cells" / str(seed) / name)
    write_text(kept, json.dumps(row))
    return row


def _measured(name: str, rig: RigConfig, config: Config, seed: int, folder: Path) -> dict[str, Any]:
    """A run on a rig as calibrated, and how true what it says of itself is."""
    truth = truth_of(name)
    material = Material.model_validate(
        {
            "name": "x",
            "truth": name,
            "channels": truth.channels,
            "seed": seed,
            "budget": {"measurements": config.measurements},
        }
    )
    if not (folder / "brdf.npz").exists():
        _again(folder)
        acquisition = start(material, rig, folder)
        try:
            acquisition()
        finally:
            acquisition.close()
        make_brdf(folder)
    brdf, budget = load_brdf(folder), budget_of(folder)
    wi, wo = nodes()
    known, which = truth.eval(wi, wo), strata(truth, wi, wo)
    size = np.maximum(known, DARK * known.max())  # a clamped channel is exactly 0
    inside, score = {}, {}
    for level in LEVELS:
        low, high = budget.interval(wi, wo, level)
        hit = (low <= known) & (known <= high)
        inside[str(level)] = [float(hit[which == k].mean()) if (which == k).any() else None for k in range(len(STRATA))]
        inside[str(level)].append(float(hit.mean()))
        missed = np.maximum(low - known, 0) + np.maximum(known - high, 0)
        score[str(level)] = float(np.median((high - low + 2 / (1 - level) * missed) / size))
    flat = np.maximum(np.arccos(np.clip(wi[:, 2], -1, 1)), np.arccos(np.clip(wo[:, 2], -1, 1))) < np.radians(70)
    u = budget.std(wi[flat], wo[flat]) / size[flat]
    z = []
    expanded = []
    for theta, (at, outward, weight, _) in zip(THETA_I, directions()):
        w = weight[:, None] * outward[:, 2:]
        ours, right = ((w * b.eval(at, outward)).sum(0) for b in (brdf, truth))  # the quadrature's own noise cancels
        r = budget.reflectance(float(theta))
        z += ((ours / right - 1) * r.value / r.u).tolist()
        expanded += r.u.tolist()
    off = np.abs(brdf.eval(wi[flat], wo[flat]) - known[flat]) / size[flat]
    return {
        "energy": evaluate(brdf, truth)["energy_mean"],
        "inside": inside,
        "score": score,
        "expanded": float(2 * np.median(u)),
        "in_expanded": float((off <= 2 * u).mean()),
        "dhr_u": float(np.median(expanded)),
        "dhr_z": z,
    }


def _again(folder: Path) -> None:
    """A run that was killed in the middle is made anew."""
    import shutil

    shutil.rmtree(folder, ignore_errors=True)


def _calibrations(rows: list[dict[str, Any]], say: Callable[[str], None]) -> None:
    g = [r["geometry"] for r in rows]
    each = lambda key: np.array([x[key] for x in g])
    say("")
    say(
        f"directions: rms {np.sqrt(np.mean(each('rms') ** 2)):.4f} deg (median {np.median(each('rms')):.4f}), worst "
        f"{each('worst').max():.3f}; before {np.sqrt(np.mean(each('before_rms') ** 2)):.2f}, "
        f"worst {each('before_worst').max():.2f}"
    )
    z = np.abs(np.concatenate([each("z").ravel(), *(r["radiometry"]["z"] for r in rows)]))
    say(f"parameters within 1, 2, 3 sigma: {_shares(z, (1, 2, 3))} of {z.size}")
    line = np.array([r["radiometry"]["linear"] for r in rows])
    say(f"linearity after correction, four decades: median {np.median(line):.3%}, worst {line.max():.3%}")
    standard = np.array([r["radiometry"]["standard"] for r in rows])
    say(f"standard at other angles, 0-60 deg: rms median {np.median(standard):.2%}, worst {standard.max():.2%}")
    say(
        f"rig time of the calibration: median {np.median([r['rig_minutes'] for r in rows]):.1f} min; "
        f"solve {np.median([r['solve_s'] for r in rows]):.2f} s"
    )


def _material(name: str, found: list[dict[str, Any]], say: Callable[[str], None]) -> None:
    say("")
    say(f"{name}, {len(found)} rigs: energy mean {np.mean([r['energy'] for r in found]):.4f}")
    for level in LEVELS:
        shares = np.array([r["inside"][str(level)] for r in found], float)
        by = "  ".join(f"{s} {v:.3f}" for s, v in zip((*STRATA, "all"), _means(shares)) if np.isfinite(v))
        say(f"  f within {level:.0%}: {by}; interval score {np.median([r['score'][str(level)] for r in found]):.3f}")
    say(
        f"  expanded uncertainty (k = 2), theta <= 70: median {np.median([r['expanded'] for r in found]):.2%}, "
        f"truth inside {np.mean([r['in_expanded'] for r in found]):.1%}"
    )
    z = np.abs(np.concatenate([r["dhr_z"] for r in found]))
    say(
        f"  DHR: u median {np.median([r['dhr_u'] for r in found]):.4f}; "
        f"within 1, 1.96, 2.58 u: {_shares(z, (1, 1.96, 2.58))}"
    )


def _means(shares: np.ndarray) -> list[float]:
    """Of each column, what is known of it; NaN where nothing is."""
    return [float(np.mean(c[np.isfinite(c)])) if np.isfinite(c).any() else np.nan for c in shares.T]


def _shares(z: np.ndarray, limits: Iterable[float]) -> str:
    return ", ".join(f"{(z <= limit).mean():.3f}" for limit in limits)
