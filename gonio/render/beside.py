"""Truth, ours and the signed difference side by side, each object under each environment: `gonio render`."""

import json
import tempfile
from pathlib import Path

import numpy as np

from gonio.atomic import beside, write_text
from gonio.brdf import Brdf
from gonio.render.environment import ENVIRONMENTS
from gonio.render.metrics import compare
from gonio.render.mitsuba import OBJECTS, render
from gonio.render.shade import to_srgb


def render_beside(ours: Brdf, truth: Brdf | None, table: Path | None, folder: Path, size: int, spp: int) -> list[str]:
    """render.png and render.json in `folder`; the lines that say what is in them. Raises MissingExtra.

    table is the truth's own .bsdf where it has one that Mitsuba reads; else one is made of it.
    """
    from matplotlib.figure import Figure

    from gonio.export.bsdf import write_bsdf

    columns = 1 if truth is None else 3
    cases = [(o, e) for o in OBJECTS for e in ENVIRONMENTS]
    figure = Figure(figsize=(3 * columns, 3.2 * len(cases)), layout="constrained")
    axes = figure.subplots(len(cases), columns, squeeze=False)
    lines, figures = [], {}
    with tempfile.TemporaryDirectory() as scratch:
        files = {"ours": Path(scratch) / "ours.bsdf", "truth": Path(scratch) / "truth.bsdf"}
        write_bsdf(ours, files["ours"])
        if table is not None:
            files["truth"] = table
        elif truth is not None:
            write_bsdf(truth, files["truth"], incidences=48, resolution=96)
        for row, (what, environment) in zip(axes, cases):
            image = render(files["ours"], what, environment, size, spp)
            name = f"{what}, {environment}"
            if truth is None:
                _show(row[0], to_srgb(image), name)
                continue
            reference = render(files["truth"], what, environment, size, spp)
            figures[name] = compare(image, reference)
            lines.append(f"{name:18} " + "  ".join(f"{k} {v:.4g}" for k, v in figures[name].items()))
            _show(row[0], to_srgb(reference), f"{name}: truth")
            _show(row[1], to_srgb(image), f"ours, {figures[name]['PSNR']:.1f} dB")
            difference = (np.clip(image, 0, 1) - np.clip(reference, 0, 1)).mean(-1)
            limit = max(0.02, float(np.abs(difference).max()))
            row[2].imshow(difference, cmap="RdBu_r", vmin=-limit, vmax=limit)
            row[2].set_title(f"difference, ± {limit:.2f}", fontsize=9)
            row[2].set_axis_off()
    with beside(folder / "render.png") as picture:
        figure.savefig(picture, format="png")
    write_text(folder / "render.json", json.dumps(figures))
    return [*lines, f"picture {folder / 'render.png'}"]


def _show(axis, image: np.ndarray, title: str) -> None:
    axis.imshow(image)
    axis.set_title(title, fontsize=9)
    axis.set_axis_off()
