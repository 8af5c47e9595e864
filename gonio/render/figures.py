"""The report's figures, each a function of plain arrays that returns a matplotlib Figure."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from gonio.brdf import Brdf
from gonio.geometry import Array, from_angles, to_half_diff
from gonio.reconstruct.samples import Samples
from gonio.render.shade import psnr, render_sphere, to_srgb

COLOURS = ("#c0392b", "#27813f", "#2c5fa8", "#777777")


def sample_cloud(samples: Samples, title: str) -> Figure:
    """Where was measured: (theta_h, theta_d, phi_d), theta_h on a root scale, coloured by log f."""
    theta_h, _, theta_d, phi_d = (np.degrees(a) for a in to_half_diff(samples.wi, samples.wo))
    value = np.log10(np.maximum(samples.f.max(1), 1e-5))
    figure = Figure(figsize=(10, 3.4), layout="constrained")
    for axis, (x, name) in zip(figure.subplots(1, 2, sharey=True), ((theta_d, "θd"), (np.abs(phi_d), "φd"))):
        dots = axis.scatter(x, np.sqrt(theta_h), c=value, s=3, cmap="viridis", linewidths=0)
        axis.set_xlabel(f"{name} [deg]")
        ticks = np.array([0.1, 1, 5, 15, 30, 60, 90])
        axis.set_yticks(np.sqrt(ticks), [f"{t:g}" for t in ticks])
    figure.axes[0].set_ylabel("θh [deg]")
    figure.colorbar(dots, ax=figure.axes, label="log10 f [1/sr]")
    figure.suptitle(title)
    return figure


def slices(brdf: Brdf, truth: Brdf | None, channels: tuple[str, ...]) -> Figure:
    """f cos theta_o in the plane of incidence at three angles; the truth dashed where it is known."""
    figure = Figure(figsize=(10, 3.2), layout="constrained")
    for axis, theta_i in zip(figure.subplots(1, 3), (15, 45, 75)):
        theta_o = mirror_angles(theta_i)
        wi = np.broadcast_to(from_angles(np.radians(theta_i), np.pi), (len(theta_o), 3))
        wo = from_angles(np.radians(np.abs(theta_o)), np.where(theta_o < 0, np.pi, 0))
        for c, name in enumerate(channels[:4]):
            axis.semilogy(theta_o, _positive(brdf.eval(wi, wo)[:, c] * wo[:, 2]), color=COLOURS[c], lw=1.2, label=name)
            if truth is not None:
                axis.semilogy(theta_o, _positive(truth.eval(wi, wo)[:, c] * wo[:, 2]), color="k", lw=0.7, ls="--")
        axis.set_title(f"θi = {theta_i}°")
        axis.set_xlabel("θo [deg], mirror side positive")
    figure.axes[0].set_ylabel("f cos θo [1/sr]")
    figure.axes[0].legend(fontsize=8)
    return figure


def mirror_angles(theta_i: float) -> Array:
    """Angles from -88 to 88 degrees, dense about the mirror direction."""
    near = theta_i + np.sinh(np.linspace(-9, 9, 401)) / np.sinh(9) * 20
    return np.unique(np.clip(np.concatenate([np.linspace(-88, 88, 353), near]), -88, 88))


def half_grids(brdf: Brdf, truth: Brdf | None) -> Figure:
    """Mean f cos over (theta_h, phi_h) at three incidences: truth above, reconstruction below."""
    rows = [("truth", truth)] if truth is not None else []
    rows.append(("reconstruction", brdf))
    figure = Figure(figsize=(10, 2.1 * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), 3, squeeze=False)
    for k, theta_i in enumerate((15, 45, 75)):
        images = [half_grid(b, np.radians(theta_i)) for _, b in rows]
        top = np.log10(max(i.max() for i in images) + 1e-12)
        for axis, (name, _), image in zip(axes[:, k], rows, images):
            axis.imshow(
                np.log10(image + 1e-12), vmin=top - 5, vmax=top, aspect="auto", extent=(0, 90, 360, 0), cmap="magma"
            )
            axis.set_title(f"{name}, θi = {theta_i}°", fontsize=9)
            axis.set_xticks([0, 30, 60, 90], ["0", "10", "40", "90"])
            axis.set_xlabel("θh [deg], square-root scale", fontsize=8)
    return figure


def half_grid(brdf: Brdf, theta_i: float, size: int = 128) -> Array:
    """Mean over channels of f cos theta_o on a grid of phi_h (rows) and theta_h = (pi/2) u^2 (columns)."""
    u, v = np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size)
    h = from_angles((np.pi / 2 * u**2).ravel(), (2 * np.pi * v).ravel())
    wi = np.broadcast_to(from_angles(theta_i, 0.0), h.shape)
    wo = 2 * np.sum(wi * h, 1)[:, None] * h - wi
    return (brdf.eval(wi, wo).mean(1) * np.maximum(wo[:, 2], 0)).reshape(size, size)


def acceptance(step: Array, accepted: Array, measured: Array) -> Figure:
    """Acceptance and share of measured proposals in windows along the run."""
    figure = Figure(figsize=(10, 2.4), layout="constrained")
    axis = figure.subplots()
    window = max(1, len(step) // 60)
    n = len(step) // window
    if n:
        for values, name in ((accepted, "accepted"), (measured, "measured")):
            axis.plot((np.arange(n) + 0.5) * window, values[: n * window].reshape(n, window).mean(1), label=name)
    axis.set_ylim(0, 1.02)
    axis.set_xlabel("step, all chains in turn")
    axis.legend()
    return figure


def albedos(edges: Array, value: Array, error: Array, channels: Sequence[str]) -> Figure:
    """Albedo (K, C) over bands of theta_i between `edges` (K + 1), radians, two standard errors either way."""
    figure = Figure(figsize=(10, 2.8), layout="constrained")
    axis = figure.subplots()
    middle, half = np.degrees(0.5 * (edges[1:] + edges[:-1])), np.degrees(0.5 * np.diff(edges))
    for c, name in list(enumerate(channels))[:8]:
        known = np.isfinite(error[:, c])
        bars = 2 * error[known, c], half[known]
        axis.errorbar(middle[known], value[known, c], *bars, ls="none", capsize=3, label=name)
    axis.set_xlabel("θi [deg]")
    axis.set_ylim(0, None)
    axis.legend()
    return figure


def budget(relative: Mapping[str, Mapping[str, float]]) -> Figure:
    """Bars of relative standard uncertainty: part -> place -> value."""
    figure = Figure(figsize=(10, 3.4), layout="constrained")
    axis = figure.subplots()
    parts, places = list(relative), list(relative["combined"])
    width = 0.8 / len(places)
    for k, place in enumerate(places):
        values = [100 * relative[p].get(place, np.nan) for p in parts]
        axis.bar(np.arange(len(parts)) + (k - len(places) / 2) * width, values, width, label=place)
    axis.set_xticks(np.arange(len(parts)), parts, fontsize=8)
    axis.set_yscale("log")
    axis.set_ylabel("u [%]")
    axis.legend(fontsize=8, ncols=len(places))
    return figure


def traces(theta_h: Array, phi_d: Array) -> Figure:
    """Traces, rank histograms and running means of theta_h over (chains, steps)."""
    from gonio.mcmc.diagnostics import mcse_mean

    figure = Figure(figsize=(10, 2.8), layout="constrained")
    trace, ranks, running = figure.subplots(1, 3)
    chains = min(len(theta_h), 8)
    order = np.argsort(np.argsort(theta_h, axis=None)).reshape(theta_h.shape)
    for c in range(chains):
        trace.plot(np.sqrt(np.degrees(theta_h[c])), lw=0.4)
        ranks.hist(order[c], bins=20, range=(0, theta_h.size), histtype="step")
        running.plot(np.cumsum(np.cos(theta_h[c])) / np.arange(1, theta_h.shape[1] + 1), lw=0.8)
    if theta_h.size > 50:
        mean, error = np.cos(theta_h).mean(), mcse_mean(np.cos(theta_h))
        running.axhspan(mean - 2 * error, mean + 2 * error, alpha=0.25)
    trace.set_title("trace of √θh [deg]")
    ranks.set_title("rank histogram of θh")
    running.set_title("running mean of cos θh, ± 2 MCSE of all")
    return figure


def spheres(brdf: Brdf, truth: Brdf | None) -> tuple[Figure, dict[str, float]]:
    """Truth, reconstruction and signed difference of a shaded sphere; PSNR where the truth is known."""
    ours = render_sphere(brdf, sampler=truth)
    if truth is None:
        figure = Figure(figsize=(3.4, 3.4), layout="constrained")
        _show(figure.subplots(), to_srgb(ours), "reconstruction")
        return figure, {}
    reference = render_sphere(truth)
    figure = Figure(figsize=(10, 3.5), layout="constrained")
    a, b, c = figure.subplots(1, 3)
    _show(a, to_srgb(reference), "truth")
    _show(b, to_srgb(ours), "reconstruction")
    difference = (np.clip(ours, 0, 1) - np.clip(reference, 0, 1)).mean(-1)
    limit = max(0.02, float(np.abs(difference).max()))
    image = c.imshow(difference, cmap="RdBu_r", vmin=-limit, vmax=limit)
    c.set_title("difference (red: too bright)")
    c.set_axis_off()
    figure.colorbar(image, ax=c, shrink=0.8)
    return figure, {"PSNR [dB]": psnr(ours, reference)}


def _show(axis, image: Array, title: str) -> None:
    axis.imshow(image)
    axis.set_title(title)
    axis.set_axis_off()


def _positive(y: Array) -> Array:
    return np.where(y > 0, y, np.nan)
