"""Truth and reconstructions of it as shaded spheres, each from the samples of a chain; how wrong each one is."""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.atomic import beside
from gonio.bench.drive import drive, truth_of
from gonio.config.loader import Section
from gonio.evaluate import evaluate
from gonio.reconstruct import Samples, reconstruct
from gonio.render.shade import psnr, render_sphere, to_srgb


class Column(Section):
    """One sphere: which chain measured, which model reconstructed."""

    title: str
    model: str
    sampler: dict | str


class Config(Section):
    study: Literal["picture"]
    material: str
    measurements: int = 10_000
    columns: tuple[Column, ...]
    size: int = 256
    spp: int = 64
    seed: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    from matplotlib.figure import Figure

    truth, n = truth_of(config.material), config.measurements
    reference = render_sphere(truth, config.size, config.spp)
    figure = Figure(figsize=(3.2 * (len(config.columns) + 1), 3.4), layout="constrained")
    axes = figure.subplots(1, len(config.columns) + 1)
    _show(axes[0], reference, f"{config.material}: truth")
    for axis, column in zip(axes[1:], config.columns):
        d = drive(truth, column.sampler, n, seed=config.seed)
        brdf = reconstruct(Samples.of(d.wi[:n], d.wo[:n], d.f[:n]), column.model)
        image = render_sphere(brdf, config.size, config.spp, sampler=truth)
        error, quality = evaluate(brdf, truth)["energy_mean"], psnr(image, reference)
        say(f"{column.title:32} energy_mean {error:.3f}  PSNR {quality:.1f} dB")
        _show(axis, image, f"{column.title}\nenergy error {error:.3f}, {quality:.0f} dB")
    path = out / f"{config.material}.png"
    with beside(path) as part:
        figure.savefig(part, dpi=110)
    say(f"picture {path}")


def _show(axis, image: np.ndarray, title: str) -> None:
    axis.imshow(to_srgb(image))
    axis.set_title(title, fontsize=9)
    axis.set_axis_off()
