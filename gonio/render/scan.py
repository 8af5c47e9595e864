"""The readings of a scan as a picture."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from gonio.geometry import Array
from gonio.render.figures import COLOURS

PANELS, SHOWN = 12, 4


def plot_scan(pairs_deg: Array, f: Array, sigma: Array, channels: Sequence[str]) -> Figure:
    """f with two sigma: over theta_o, positive on the mirror side, a panel for each theta_i of pairs in a plane of
    incidence; else over the row of the list. pairs_deg (N, 4); f, sigma (N, C), NaN is left out."""
    theta_i, phi_i, theta_o, phi_o = pairs_deg.T
    apart = np.mod(phi_o - phi_i, 360.0)
    mirror = np.isclose(apart, 180)
    planes = np.stack([theta_i, np.mod(phi_i + 180, 360)], 1).round(6)
    kinds = np.unique(planes, axis=0)
    if (mirror | np.isclose(np.mod(apart + 1, 360), 1) | (theta_o == 0)).all() and len(kinds) <= PANELS:
        x = np.where(mirror, theta_o, -theta_o)
        groups = [(f"θi = {t:g}°, plane at {phi:g}°", (planes == (t, phi)).all(1)) for t, phi in kinds]
        label = "θo [deg], mirror side positive"
    else:
        x, groups, label = np.arange(len(f)), [(f"{len(f)} pairs", np.ones(len(f), bool))], "row of the list"
    figure = Figure(figsize=(4.2 * min(len(groups), 4), 3.4 * -(-len(groups) // 4)), layout="constrained")
    axes = figure.subplots(-(-len(groups) // 4), min(len(groups), 4), squeeze=False).ravel()
    for axis, (title, rows) in zip(axes, groups):
        order = np.flatnonzero(rows)[np.argsort(x[rows], kind="stable")]
        for c, name in enumerate(list(channels)[:SHOWN]):
            y, u = f[order, c], 2 * sigma[order, c]
            axis.errorbar(x[order], y, u, color=COLOURS[c], label=name, marker=".", ms=4, lw=0.8, capsize=2)
        if (f[order][np.isfinite(f[order])] > 0).all() and np.isfinite(f[order]).any():
            axis.set_yscale("log")
        axis.set_title(title)
        axis.set_xlabel(label)
    for axis in axes[len(groups) :]:
        axis.set_visible(False)
    figure.axes[0].set_ylabel("f [1/sr], ± 2σ")
    figure.axes[0].legend(fontsize=8)
    return figure
