"""How much of a reconstruction's error is seen: PSNR of a shaded sphere beside the truth's, material by material.

The sphere of `gonio.render.shade` (a sky and three lamps), linear RGB clipped to [0, 1], background included. Truth and
reconstruction see the same random directions, in two renders of their own seeds; the mean squared error is the mean
product of the two differences, in which the renders' noise has no say. "exposed" is the same with the exposure at
which a hundredth of the truth's lit pixels is white: as the lamps are, dark materials are flattered. "bsdf" is what a
renderer gets to see: the exported table instead of the reconstruction itself.
"""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.atomic import write_text
from gonio.bench.accuracy.reconstruction import Noise, noisy
from gonio.bench.drive import drive, truth_of
from gonio.brdf import Brdf
from gonio.config.loader import Section
from gonio.export.bsdf import as_brdf
from gonio.geometry import Array
from gonio.reconstruct import reconstruct
from gonio.render.shade import render_sphere


class Config(Section):
    """goal: mean and worst PSNR in dB."""

    study: Literal["rendered"]
    materials: tuple[str, ...]
    models: tuple[str, ...] = ("auto",)
    sampler: dict | str
    chains: int = 4
    measurements: int = 10_000
    noise: Noise = Noise(relative=0.005, read=3.2e-5)
    size: int = 64
    spp: int = 128
    goal: tuple[float, float] = (45.0, 38.0)
    seed: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    say(f"{'material':22}{'model':8}{'PSNR':>8}{'exposed':>9}{'bsdf':>8}{'exposed':>9}  [dB]")
    rows: list[dict] = []
    for material in config.materials:
        truth = truth_of(material)
        d = drive(truth, config.sampler, config.measurements, chains=config.chains, seed=config.seed)
        samples = noisy(d.wi, d.wo, d.f, config.noise, config.seed)[: config.measurements]
        reference = _renders(truth, truth, config)
        for model in config.models:
            brdf = reconstruct(samples, model)
            values: list[float] = []
            for seen in (brdf, as_brdf(brdf)):
                images = _renders(seen, truth, config)
                values += [noise_free_psnr(images, reference, e) for e in (1.0, exposure(reference))]
            rows.append({"material": material, "model": model, "psnr": values})
            say(f"{material:22}{model:8}" + "{:8.1f}{:9.1f}{:8.1f}{:9.1f}".format(*values))
        write_text(out / "rows.json", json.dumps(rows, indent=1))
    for model in config.models:
        table = np.array([r["psnr"] for r in rows if r["model"] == model])
        for word, values, goal in zip(("mean", "worst"), (table.mean(0), table.min(0)), config.goal):
            verdict = "met" if values[0] >= goal else "missed"
            say(f"{word:22}{model:8}" + "{:8.1f}{:9.1f}{:8.1f}{:9.1f}".format(*values) + f"  goal {goal:g}: {verdict}")


def noise_free_psnr(images: Array, reference: Array, scale: float) -> float:
    """dB, of two renders (2, H, W, 3) each, the pairs drawn alike; at least 1e-12 of squared error."""
    first, second = np.clip(scale * images, 0, 1) - np.clip(scale * reference, 0, 1)
    return float(-10 * np.log10(max(1e-12, np.mean(first * second))))


def exposure(reference: Array) -> float:
    lit = reference.max(-1)
    return float(1 / np.quantile(lit[lit > 0], 0.99))


def _renders(brdf: Brdf, truth: Brdf, config: Config) -> Array:
    """(2, size, size, 3)."""
    seeds = (config.seed, config.seed + 1)
    return np.array([render_sphere(brdf, config.size, config.spp, sampler=truth, seed=s) for s in seeds])
