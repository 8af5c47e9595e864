"""The same samples, several reconstructions: truth, each model, and what is wrong with it, as shaded spheres."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.bench.drive import drive, truth_of
from gonio.config.loader import Section
from gonio.evaluate import evaluate
from gonio.reconstruct import Samples, reconstruct
from gonio.render.shade import psnr, render_sphere, to_srgb


class Config(Section):
    study: Literal["picture"]
    material: str
    measurements: int = 10_000
    models: tuple[str, ...] = ("thesis", "auto")
    sampler: dict | str = {"proposal": "auto"}
    size: int = 256
    spp: int = 64
    seed: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    from matplotlib.figure import Figure

    truth = truth_of(config.material)
    n = config.measurements
    d = drive(truth, config.sampler, n, seed=config.seed)
    samples = Samples.of(d.wi[:n], d.wo[:n], d.f[:n])
    reference = render_sphere(truth, config.size, config.spp)
    figure = Figure(figsize=(3.2 * (len(config.models) + 1), 3.4), layout="constrained")
    axes = figure.subplots(1, len(config.models) + 1)
    _show(axes[0], reference, f"{config.material}: truth")
    for axis, model in zip(axes[1:], config.models):
        brdf = reconstruct(samples, model)
        image = render_sphere(brdf, config.size, config.spp, sampler=truth)
        figures, quality = evaluate(brdf, truth), psnr(image, reference)
        say(f"{model:8} energy_mean {figures['energy_mean']:.3f}  PSNR {quality:.1f} dB")
        _show(axis, image, f"{model}: energy error {figures['energy_mean']:.3f}, {quality:.0f} dB")
    path = out / f"{config.material}.png"
    figure.savefig(path, dpi=110)
    say(f"picture {path}")


def _show(axis, image: np.ndarray, title: str) -> None:
    axis.imshow(to_srgb(image))
    axis.set_title(title, fontsize=9)
    axis.set_axis_off()
