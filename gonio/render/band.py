"""How far the picture could be off: a BRDF's lower and upper ends of 95 % rendered beside it, `gonio render --band`."""

import tempfile
from pathlib import Path
from typing import Protocol

import numpy as np

from gonio.atomic import beside
from gonio.brdf import Brdf
from gonio.geometry import Array
from gonio.render.environment import ENVIRONMENTS
from gonio.render.mitsuba import OBJECTS, render
from gonio.render.shade import to_srgb

LEVEL = 0.95


class WithIntervals(Brdf, Protocol):
    """A BRDF that knows how far off it may be."""

    def interval(self, wi: Array, wo: Array, level: float) -> tuple[Array, Array]: ...


class End:
    """One end of the interval as a BRDF: 0 the lower, 1 the upper. Drawn from as the BRDF itself is."""

    def __init__(self, brdf: WithIntervals, end: int):
        self.brdf, self.end, self.channels = brdf, end, brdf.channels
        self.sample, self.pdf = brdf.sample, brdf.pdf

    def eval(self, wi: Array, wo: Array) -> Array:
        return self.brdf.interval(wi, wo, LEVEL)[self.end]


def render_band(brdf: WithIntervals, folder: Path, size: int, spp: int) -> list[str]:
    """band.png in `folder`; lines that say how wide it is. Raises MissingExtra, ExportError.

    Every pair of directions is at its own end at once, which is farther out than all of them would be together: the
    picture lies between the two, nearly always.
    """
    from matplotlib.figure import Figure

    from gonio.export.bsdf import write_bsdf

    cases = [(o, e) for o in OBJECTS for e in ENVIRONMENTS]
    figure = Figure(figsize=(9, 3.2 * len(cases)), layout="constrained")
    axes = figure.subplots(len(cases), 3, squeeze=False)
    lines = []
    with tempfile.TemporaryDirectory() as scratch:
        files = {}
        for name, one in (("lower end", End(brdf, 0)), ("ours", brdf), ("upper end", End(brdf, 1))):
            files[name] = Path(scratch) / f"{name}.bsdf"
            write_bsdf(one, files[name])
        for row, (what, environment) in zip(axes, cases):
            images = {name: render(path, what, environment, size, spp) for name, path in files.items()}
            for axis, (name, image) in zip(row, images.items()):
                axis.imshow(to_srgb(image))
                axis.set_title(f"{what}, {environment}: {name}", fontsize=9)
                axis.set_axis_off()
            low, ours, high = (image.mean(-1) for image in images.values())
            seen = (high > low) & (ours > 0)  # the sky behind is the same in all
            wide = np.median((high - low)[seen] / (2 * ours[seen])) if seen.any() else 0.0
            lines.append(f"{what + ', ' + environment:18} half the band: {100 * wide:.1f} % of a pixel, by the median")
    with beside(folder / "band.png") as picture:
        figure.savefig(picture, format="png")
    return [*lines, f"picture {folder / 'band.png'}"]
