"""Rendered spheres of the thesis's chapter 5: truth and what was made of the samples, in colour and by channel."""

import numpy as np
from matplotlib.figure import Figure

from gonio.geometry import Array
from gonio.render.shade import psnr, render_sphere, to_srgb
from gonio.render.thesis.subject import Missing, Subject

MATERIALS = {  # the thesis's figure -> its material
    "5.1": "acrylic_felt_purple",
    "5.2": "cc_ibiza_sunset",
    "5.3": "aurora_white",
    "5.4": "chm_orange",
    "5.5": "ilm_solo_m_68",
}
FEW = 2  # samples per pixel where the noise of a density is to be seen


def material(number: str, s: Subject) -> Figure:
    """5.1 to 5.5: truth, the thesis's method, ours. A material that the thesis did not have goes by 5.1."""
    own = next((k for k, name in MATERIALS.items() if name == s.name), "5.1")
    if number != own:
        name = MATERIALS[number]
        raise Missing(f"shows {name}; run that, or `gonio bench picture --set material={name}`")
    panels = [("truth", s.truth_image), ("thesis method", s.thesis_image), ("ours", s.our_image)]
    return _row(panels, f"{s.name}: {len(s.samples)} samples")


def densities(s: Subject) -> Figure:
    """5.6: the truth, directions drawn by the thesis's visible normals, by ours, by a flow: few, to see the noise."""
    reference = s.truth_image
    panels = [("truth", reference)]
    drawn_by = [("thesis pdf", s.thesis), ("our pdf", s.ours)]
    if s.flow is not None:
        drawn_by.append(("flow pdf", s.flow))
    panels += [(name, render_sphere(s.known, s.size, FEW, sampler=by, seed=2)) for name, by in drawn_by]
    return _row(panels, f"{s.name}: the true BRDF, {FEW} directions a pixel drawn by")


def red(s: Subject) -> Figure:
    """5.7: the red channel in grey."""
    panels = [("truth", s.truth_image), ("thesis method", s.thesis_image), ("ours", s.our_image)]
    if s.flow is not None:
        panels.append(("flow", s.flow_image))
    return _row([(name, _grey(image, 0)) for name, image in panels], f"{s.name}: {s.channels[0]} in grey")


def other_channels(s: Subject) -> Figure:
    """5.8: where the thesis's flow failed, the other two channels: its method on these samples, ours, and a flow."""
    s.need_colours()
    columns = [("truth", s.truth_image), ("thesis method", s.thesis_image), ("ours", s.our_image)]
    if s.flow is not None:
        columns.append(("flow", s.flow_image))
    figure = Figure(figsize=(2.6 * len(columns), 5.6), layout="constrained")
    axes = figure.subplots(2, len(columns))
    for row, channel in zip(axes, (1, 2)):
        for axis, (name, image) in zip(row, columns):
            _show(axis, f"{s.channels[channel]}, {name}", _grey(image, channel), _grey(columns[0][1], channel))
    return figure


def flows(s: Subject) -> Figure:
    """5.9: truth, the flow's reconstruction, ours."""
    return _row([("truth", s.truth_image), ("flow", s.flow_image), ("ours", s.our_image)], s.name)


def _grey(image: Array, channel: int) -> Array:
    return np.repeat(image[..., channel : channel + 1], 3, -1)


def _row(panels: list[tuple[str, Array]], title: str) -> Figure:
    figure = Figure(figsize=(2.8 * len(panels), 3.3), layout="constrained")
    for axis, (name, image) in zip(figure.subplots(1, len(panels)), panels):
        _show(axis, name, image, panels[0][1])
    figure.suptitle(title, fontsize=10)
    return figure


def _show(axis, name: str, image: Array, reference: Array) -> None:
    quality = "" if image is reference or np.array_equal(image, reference) else f", {psnr(image, reference):.1f} dB"
    axis.imshow(to_srgb(image))
    axis.set_title(name + quality, fontsize=9)
    axis.set_axis_off()
