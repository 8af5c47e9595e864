"""Slices over half vectors as the thesis's chapter 6 shows them: columns theta_h = (pi/2) u^2, rows phi_h = 2 pi v.

A slice holds g = f cos(theta_o), (ROWS, COLUMNS, C), of one incidence; phi_h counts from the light's azimuth. What is
symmetric about the plane of incidence is shown by half: above the truth, below the fit, rows outwards from the middle.
"""

import numpy as np
from matplotlib.figure import Figure

from gonio.brdf import Brdf
from gonio.brdf.tables.slices import half_vectors
from gonio.geometry import Array, from_angles, reflect
from gonio.render.thesis.subject import Missing, Subject

ROWS, COLUMNS = 65, 128
SMALL, MIDDLE, LARGE = 15.0, 45.0, 75.0  # incidences shown, degrees
FIRST, LAST = 30, 50
MOST = 0.8  # share of the energy in the columns "most importance sampled"


def incidence(theta_i: float) -> tuple[Array, Array, Array]:
    """wi, wo (ROWS * COLUMNS, 3) of the slice at theta_i degrees, and the half vectors' solid angle per dv du."""
    h = half_vectors(ROWS, COLUMNS).reshape(-1, 3)
    wi = np.broadcast_to(from_angles(np.radians(theta_i), 0.0), h.shape)
    u = np.tile(np.linspace(0, 1, COLUMNS), ROWS)
    return wi, reflect(wi, h), np.sin(np.pi / 2 * u * u) * np.pi * u * 2 * np.pi


def slice_of(brdf: Brdf, theta_i: float) -> Array:
    wi, wo, _ = incidence(theta_i)
    return (brdf.eval(wi, wo) * np.maximum(wo[:, 2:], 0)).reshape(ROWS, COLUMNS, -1)


def energy_density(brdf: Brdf, theta_i: float) -> Array:
    """(ROWS, COLUMNS): the density over (v, u) of half vectors in proportion to the mean of g, thesis (6.2)."""
    wi, wo, area = incidence(theta_i)
    jacobian = area * 4 * np.maximum(np.einsum("ni,ni->n", wi, wi + wo) / np.linalg.norm(wi + wo, axis=1), 0)
    density = slice_of(brdf, theta_i).mean(-1) * jacobian.reshape(ROWS, COLUMNS)
    return density / max(float(density.mean()), 1e-300)


def most_sampled(density: Array) -> slice:
    """The fewest columns in a row that hold MOST of a density."""
    share = np.concatenate([[0.0], np.cumsum(density.sum(0) / density.sum())])
    first = np.arange(len(share) - 1)
    last = np.searchsorted(share, share[first] + MOST)
    width = np.where(last < len(share), last - first, len(share))
    best = int(np.argmin(width))
    return slice(best, best + max(2, int(width[best])))


def pdf(s: Subject) -> Figure:
    """6.2: the density that a renderer should draw half vectors from, its first columns."""
    known = s.ours if s.truth is None else s.truth
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    for axis, theta_i in zip(figure.subplots(1, 3), (SMALL, MIDDLE, LARGE)):
        image = energy_density(known, theta_i)[:, :FIRST]
        _show(figure, axis, image, f"θi = {theta_i:g}°, columns 0 to {FIRST - 1}")
    return figure


def most_sampled_columns(s: Subject) -> Figure:
    """6.3: the columns that carry the energy, truth above and fit below: the thesis's method, ours."""
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    columns = most_sampled(energy_density(s.known, MIDDLE))
    truth = slice_of(s.known, MIDDLE)[:, columns, 0]
    axes = figure.subplots(1, 2)
    for axis, (name, brdf) in zip(axes, (("thesis method", s.thesis), ("ours", s.ours))):
        image = over(truth, slice_of(brdf, MIDDLE)[:, columns, 0])
        _show(figure, axis, image, f"truth over {name}, columns {columns.start} to {columns.stop - 1}")
    figure.suptitle(f"f cos θo of {s.channels[0]}, θi = {MIDDLE:g}°", fontsize=10)
    return figure


def weights(s: Subject) -> Figure:
    """6.4: the weight f cos / pdf that a renderer multiplies by, at a small and at a large incidence."""
    figure = Figure(figsize=(9, 5.6), layout="constrained")
    for row, (name, brdf) in zip(figure.subplots(2, 2), (("thesis method", s.thesis), ("ours", s.ours))):
        for axis, theta_i in zip(row, (SMALL, LARGE)):
            wi, wo, _ = incidence(theta_i)
            pdf = np.maximum(brdf.pdf(wi, wo), 1e-12).reshape(ROWS, COLUMNS)
            image = slice_of(brdf, theta_i).mean(-1) / pdf
            _show(figure, axis, np.log10(np.clip(image, 1e-3, 1e3)), f"{name}: log10 of the weight, θi = {theta_i:g}°")
    return figure


def flow_slices(s: Subject) -> Figure:
    """6.6: c pdf of the run's flow below what is known, near grazing: all columns, and without the first three."""
    if s.density is None:
        raise Missing("needs a flow's density; make it with `gonio reconstruct RUN --model flow --out RUN/flow.npz`")
    wi, wo, _ = incidence(LARGE)
    up = wo[:, 2] > 0
    fitted = np.zeros(len(wo))
    fitted[up] = constant(s) * np.exp(s.density.log_prob(wi[up], wo[up]))
    name, known = ("ours", s.ours) if s.truth is None else ("truth", s.truth)
    both = over(slice_of(known, LARGE).mean(-1), fitted.reshape(ROWS, COLUMNS))
    figure = Figure(figsize=(9, 3.2), layout="constrained")
    for axis, first in zip(figure.subplots(1, 2), (0, 3)):
        _show(figure, axis, both[:, first:20], f"{name} over flow, θi = {LARGE:g}°, columns {first} to 19")
    return figure


def constant(s: Subject) -> float:
    """c of thesis (4.15): the least squares of c pdf against the mean of f cos over the samples."""
    assert s.density is not None
    up = (s.samples.wi[:, 2] > 1e-6) & (s.samples.wo[:, 2] > 1e-6)
    q = np.exp(s.density.log_prob(s.samples.wi[up], s.samples.wo[up]))
    g = s.samples.f[up].mean(1) * s.samples.wo[up, 2]
    return float((q * g).sum() / (q * q).sum())


def last_columns(s: Subject) -> Figure:
    """6.7: the last columns, where f is low: green and red, truth above and fit below, on the truth's own scale."""
    s.need_colours()
    fits = [("thesis method", s.thesis), ("ours", s.ours)]
    if s.flow is not None:
        fits.append(("flow", s.flow))
    figure = Figure(figsize=(9, 2.8 * len(fits)), layout="constrained")
    truth = slice_of(s.known, SMALL)[:, -LAST:]
    for row, (name, brdf) in zip(figure.subplots(len(fits), 2), fits):
        fit = slice_of(brdf, SMALL)[:, -LAST:]
        for axis, channel in zip(row, (1, 0)):
            image = over(truth[..., channel], fit[..., channel])
            _show(
                figure,
                axis,
                image,
                f"{s.channels[channel]}: truth over {name}, θi = {SMALL:g}°",
                by=truth[..., channel],
            )
    return figure


def over(above: Array, below: Array) -> Array:
    """The upper half of one slice over the lower half of another: mirror images, if they agree."""
    return np.concatenate([above[: ROWS // 2 + 1], below[ROWS // 2 :]])


def _show(figure: Figure, axis, image: Array, title: str, by: Array | None = None) -> None:
    scale = {} if by is None else {"vmin": 0.0, "vmax": float(by.max()) or 1.0}
    shown = axis.imshow(image, aspect="auto", cmap="magma", interpolation="nearest", **scale)
    axis.set_title(title, fontsize=9)
    axis.set_yticks([])
    figure.colorbar(shown, ax=axis, shrink=0.8)
