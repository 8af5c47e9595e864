"""Which function makes which figure of the thesis, and the page that shows them."""

import html
from collections.abc import Callable
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure

from gonio.atomic import beside, write_text
from gonio.reconstruct.errors import ReconstructionError
from gonio.render.thesis import clouds, grids, spheres, warped
from gonio.render.thesis.subject import Missing, Subject

FIGURES: dict[str, tuple[str, Callable[[Subject], Figure]]] = {
    "5.1": ("Rough purple material", partial(spheres.material, "5.1")),
    "5.2": ("Rough cc_ibiza material", partial(spheres.material, "5.2")),
    "5.3": ("White material", partial(spheres.material, "5.3")),
    "5.4": ("chm_orange material", partial(spheres.material, "5.4")),
    "5.5": ("ilm blue material", partial(spheres.material, "5.5")),
    "5.6": ("Comparison of pdfs", spheres.densities),
    "5.7": ("Red channel in grey", spheres.red),
    "5.8": ("Green and blue channel", spheres.other_channels),
    "5.9": ("Flow reconstruction", spheres.flows),
    "6.1": ("Sample distributions by proposal", clouds.clouds),
    "6.2": ("A 2D pdf grid", grids.pdf),
    "6.3": ("Most importance sampled columns", grids.most_sampled_columns),
    "6.4": ("Importance sampling weight", grids.weights),
    "6.5": ("BRDF on a non-uniform grid", warped.non_uniform),
    "6.6": ("BRDF fitted by a flow", grids.flow_slices),
    "6.7": ("Last 50 columns", grids.last_columns),
}


def make_figure(number: str, s: Subject, folder: Path) -> Path:
    """figure_5_1.png and so on in `folder`. Raises Missing, its line led by the number."""
    try:
        figure = FIGURES[number][1](s)
    except (Missing, ReconstructionError) as e:
        raise Missing(f"figure {number}: {e}") from None
    path = folder / f"figure_{number.replace('.', '_')}.png"
    with beside(path) as part:
        figure.savefig(part, dpi=110)
    return path


def make_all(s: Subject, folder: Path) -> list[str]:
    """Every figure that this run allows and index.html; a line for each figure, made or not."""
    lines, parts = [], []
    for number, (title, function) in FIGURES.items():
        text = html.escape((function.func if isinstance(function, partial) else function).__doc__ or "")
        head = f"<h2>{number} {title}</h2><p>{text}</p>"
        try:
            path = make_figure(number, s, folder)
        except Missing as e:
            parts.append(f"{head}<p><em>Not made: {html.escape(str(e))}</em></p>")
            lines.append(f"left out {e}")
        else:
            parts.append(f'{head}<img src="{path.name}" alt="{number}">')
            lines.append(f"figure {number}  {path}")
    style = "body{font:15px/1.5 system-ui,sans-serif;margin:2rem auto;max-width:64rem}img{max-width:100%}"
    title = html.escape(f"{s.name}: the figures of the thesis")
    page = f"<!doctype html><meta charset=utf-8><title>{title}</title><style>{style}</style><h1>{title}</h1>"
    write_text(folder / "index.html", page + "".join(parts))
    return [*lines, f"index  {folder / 'index.html'}"]
