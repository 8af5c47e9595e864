"""Curves in the plane of incidence: of a BRDF, and of a scan's readings."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gonio.brdf import Brdf
from gonio.geometry import Array, from_angles
from gonio.render.figures import COLOURS, mirror_angles

SHOWN = 4  # channels


def plot_brdf(brdf: Brdf, theta_i_deg: Sequence[float], truth: Brdf | None = None) -> Figure:
    """f cos theta_o over theta_o (mirror side positive), one panel an incidence; up to four channels.

    A band is the interval of 95 % of a BRDF that has one; the truth is dashed. Raises ValueError for angles that are
    not within 0 … 89 degrees, ConfigError's own for none.
    """
    angles = [float(t) for t in np.atleast_1d(np.asarray(theta_i_deg, float))]
    if not angles or not all(0 <= t < 89 for t in angles):
        raise ValueError(f"theta_i_deg: {angles}; wanted degrees from 0 to below 89")
    figure = Figure(figsize=(3.4 * len(angles), 3.2), layout="constrained")
    for axis, theta_i in zip(figure.subplots(1, len(angles), squeeze=False)[0], angles):
        _curves(axis, brdf, truth, theta_i)
        axis.set_title(f"θi = {theta_i:g}°")
        axis.set_xlabel("θo [deg], mirror side positive")
    figure.axes[0].set_ylabel("f cos θo [1/sr]")
    return figure


def _curves(axis: Axes, brdf: Brdf, truth: Brdf | None, theta_i: float) -> None:
    theta_o = mirror_angles(theta_i)
    wi, wo = in_plane(theta_i, theta_o)
    cos = wo[:, 2:]
    f = brdf.eval(wi, wo) * cos
    interval = getattr(brdf, "interval", None)
    band = None if interval is None else [end * cos for end in interval(wi, wo, 0.95)]
    for c in range(min(brdf.channels, SHOWN)):
        axis.semilogy(theta_o, np.maximum(f[:, c], 1e-7), color=COLOURS[c], lw=1.2)
        if band is not None:
            axis.fill_between(theta_o, *(np.maximum(end[:, c], 1e-7) for end in band), color=COLOURS[c], alpha=0.15)
        if truth is not None:
            axis.semilogy(theta_o, np.maximum(truth.eval(wi, wo)[:, c] * cos[:, 0], 1e-7), "k--", lw=0.7)


def in_plane(theta_i_deg: float, theta_o_deg: Array) -> tuple[Array, Array]:
    """wi, wo (N, 3) in the plane x, z: light at -x, angles of wo positive on the mirror side (+x)."""
    wi = np.broadcast_to(from_angles(np.radians(theta_i_deg), np.pi), (len(theta_o_deg), 3))
    return wi, from_angles(np.radians(np.abs(theta_o_deg)), np.where(theta_o_deg < 0, np.pi, 0.0))
