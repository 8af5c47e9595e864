"""Every reconstruction on every material: error of the BRDF against measurements, with and without the rig's noise.

One run per material and N, by the sampler of the study. Noise: sigma^2 = (relative f)^2 + (read / cos theta_i)^2, half
a percent and 1e-4 of a white surface's 1/pi unless told otherwise. The figures are the referee's (`gonio.evaluate`),
"channel" the worst channel's energy. "estimate" is the reconstruction's own error estimate over the true error;
"inside" the share of true values within one of its standard deviations, at pairs even over both hemispheres.
"""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from gonio.atomic import beside, write_text
from gonio.bench.drive import drive, truth_of
from gonio.brdf import Brdf
from gonio.config.loader import Section
from gonio.evaluate import evaluate
from gonio.geometry import Array, from_angles
from gonio.reconstruct import ReconstructionError, Samples, reconstruct
from gonio.reconstruct.splines.auto import AutoBrdf

EVERYWHERE = 3000
AZIMUTHS: dict[str, tuple[float, ...]] = {"isotropic": (), "anisotropic": (0.7, 1.5708, 2.3)}  # of wi, besides 0


class Noise(Section):
    """Standard deviations: a share of f, and of f cos(theta_i) in 1/sr."""

    relative: float = 0.0
    read: float = 0.0


class Config(Section):
    """materials: names, paths, or FILE.npz:* for every `every`-th network of a file; goals: energy_mean by N."""

    study: Literal["reconstruction"]
    materials: tuple[str, ...]
    every: int = 1
    models: tuple[str, ...] = ("auto",)
    sampler: dict | str = Field(default_factory=lambda: {"proposal": "auto"})
    chains: int = 4
    symmetry: Literal["isotropic", "anisotropic"] = "isotropic"
    measurements: tuple[int, ...] = (300, 1000, 10000)
    noise: dict[str, Noise] = Field(
        default_factory=lambda: {"none": Noise(), "rig": Noise(relative=0.005, read=3.2e-5)}
    )
    goals: dict[int, float] = Field(default_factory=dict)
    seed: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    say(
        f"{'material':28}{'model':10}{'noise':7}{'N':>8}{'energy':>9}{'channel':>9}{'grazing':>9}{'bright':>14}{'log':>8}"
        f"{'estimate':>10}{'inside':>8}{'CPU s':>7}"
    )
    rows: list[dict] = []
    for name in materials(config):
        truth = truth_of(name)
        pairs = _everywhere()
        for n in config.measurements:
            d = drive(truth, config.sampler, n, chains=config.chains, seed=config.seed, symmetry=config.symmetry)
            for label, noise in config.noise.items():
                s = noisy(d.wi[:n], d.wo[:n], d.f[:n], noise, config.seed)
                for model in config.models:
                    row = {
                        "material": name,
                        "model": model,
                        "noise": label,
                        "n": n,
                        **_figures(s, model, truth, (*pairs, truth.eval(*pairs)), config.symmetry),
                    }
                    rows.append(row)
                    say(_line(rows[-1]))
        write_text(out / "rows.json", json.dumps(rows, indent=1))
    _summary(config, rows, say)
    _plot(config, rows, out)


def materials(config: Config) -> list[str]:
    """The study's materials, `FILE.npz:*` spelled out."""
    names: list[str] = []
    for m in config.materials:
        if m.endswith(".npz:*"):
            with np.load(m[:-2]) as file:
                names += [f"{m[:-2]}:{network}" for network in file["names"][:: config.every]]
        else:
            names.append(m)
    return names


def noisy(wi: Array, wo: Array, f: Array, noise: Noise, seed: int) -> Samples:
    """Those above the horizon, as a rig of this noise reads them."""
    up = (wi[:, 2] > 1e-3) & (wo[:, 2] > 1e-3)
    wi, wo, f = wi[up], wo[up], f[up]
    sigma = np.hypot(noise.relative * f, noise.read / wi[:, 2:])
    return Samples.of(wi, wo, f + sigma * np.random.default_rng(seed).standard_normal(f.shape), sigma)


def _everywhere() -> tuple[Array, Array]:
    """Pairs (EVERYWHERE, 3), even over both hemispheres down to half a degree above the horizon."""
    rng = np.random.default_rng(5)
    theta = np.arccos(rng.uniform(0.01, 1, (2, EVERYWHERE)))
    wi, wo = (from_angles(t, p) for t, p in zip(theta, 2 * np.pi * rng.random((2, EVERYWHERE))))
    return wi, wo


def _figures(s: Samples, model: str, truth: Brdf, held_out: tuple[Array, Array, Array], symmetry: str) -> dict:
    began = time.process_time()
    try:
        brdf = reconstruct(s, model, anisotropic=symmetry == "anisotropic")
    except ReconstructionError as e:
        return {"refused": str(e)}
    seconds = time.process_time() - began
    turns = [evaluate(Turned(brdf, phi), Turned(truth, phi)) for phi in (0.0, *AZIMUTHS[symmetry])]
    row = {"seconds": seconds, **{k: float(np.mean([t[k] for t in turns])) for k in turns[0]}}
    if isinstance(brdf, AutoBrdf):
        row["estimate"] = brdf.energy_error_estimate / row["energy_mean"]
        wi, wo, f = held_out
        row["inside"] = float((np.abs(brdf.eval(wi, wo) - f) <= brdf.std(wi, wo)).mean())
    return row


class Turned:
    """A BRDF whose sample lies turned by phi, radians."""

    def __init__(self, brdf: Brdf, phi: float):
        c, s = np.cos(phi), np.sin(phi)
        self.brdf, self.turn, self.channels = brdf, np.array([[c, s, 0], [-s, c, 0], [0, 0, 1.0]]), brdf.channels
        self.sample, self.pdf = brdf.sample, brdf.pdf

    def eval(self, wi: Array, wo: Array) -> Array:
        return self.brdf.eval(wi @ self.turn, wo @ self.turn)


def _line(row: dict) -> str:
    short = row["material"].rpartition(":")[2]
    head = f"{short[-27:]:28}{row['model']:10}{row['noise']:7}{row['n']:8}"
    if "refused" in row:
        return head + "  refused: " + row["refused"]
    bright = f"{row['bright_min']:.3f}…{row['bright_max']:.3f}"
    more = f"{row['estimate']:10.2f}{row['inside']:8.2f}" if "estimate" in row else f"{'–':>10}{'–':>8}"
    energy = f"{row['energy_mean']:9.4f}{row['energy_worst_channel']:9.4f}"
    figures = f"{energy}{row['grazing']:9.4f}{bright:>14}{row['log']:8.3f}"
    return head + figures + more + f"{row['seconds']:7.1f}"


def _summary(config: Config, rows: list[dict], say: Callable[[str], None]) -> None:
    say("")
    say(f"{'mean of all materials':28}{'model':10}{'noise':7}{'N':>8}{'energy':>9}{'worst':>9}{'grazing':>9}  goal")
    for label in config.noise:
        for n in config.measurements:
            for model in config.models:
                some = [r for r in rows if (r["noise"], r["n"], r["model"]) == (label, n, model) and "refused" not in r]
                if not some:
                    continue
                energy = np.array([r["energy_mean"] for r in some])
                grazing = np.mean([r["grazing"] for r in some])
                goal = config.goals.get(n)
                verdict = "" if goal is None else f"{goal:g} {'met' if energy.mean() <= goal else 'missed'}"
                head = f"{len(some):<28}{model:10}{label:7}{n:8}"
                say(f"{head}{energy.mean():9.4f}{energy.max():9.4f}{grazing:9.4f}  {verdict}")
    known = [r for r in rows if "estimate" in r]
    if known:
        ratio = np.array([r["estimate"] for r in known])
        inside = np.array([r["inside"] for r in known])
        say(f"estimate / error within 0.5 … 2: {np.mean((ratio > 0.5) & (ratio < 2)):.0%} of {len(known)} rows")
        say(f"truth within one std: median {np.median(inside):.2f}, {np.mean(np.abs(inside - 0.68) < 0.08):.0%} ± 0.08")


def _plot(config: Config, rows: list[dict], out: Path) -> None:
    """Error and CPU seconds against N, one line per model and noise: means over materials, worst and best as a band."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 4.5), layout="constrained")
    panels = figure.subplots(1, 2)
    for key, axes in zip(("energy_mean", "seconds"), panels):
        for model in config.models:
            for label, style in zip(config.noise, ("-", "--", ":")):
                mine = [r for r in rows if (r["model"], r["noise"]) == (model, label) and "refused" not in r]
                by_n = [(n, [r[key] for r in mine if r["n"] == n]) for n in config.measurements]
                by_n = [(n, values) for n, values in by_n if values]
                if not by_n:
                    continue
                n, mean, low, high = zip(*((n, np.mean(v), min(v), max(v)) for n, v in by_n))
                (line,) = axes.loglog(n, mean, style, label=f"{model}, noise {label}")
                axes.fill_between(n, low, high, color=line.get_color(), alpha=0.08)
        axes.set_xlabel("measurements")
    panels[0].set_ylabel("energy error")
    panels[1].set_ylabel("CPU seconds")
    panels[0].legend(fontsize="small")
    with beside(out / "error.png") as part:
        figure.savefig(part, dpi=150)
