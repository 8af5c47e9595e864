"""A run's flow beside its samples, as in the thesis's figures 6.1, 6.6, 6.7."""

import numpy as np
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure

from gonio.geometry import Array, above_horizon, from_half_diff, to_half_diff
from gonio.reconstruct.samples import Samples

FINE = (160, 120)
PHI_D = np.pi * (np.arange(12) + 0.5) / 12


def flow_beside_samples(density, samples: Samples) -> Figure:
    """Left the samples, right the flow's density, over log theta_h and theta_d, summed over phi_d.

    density has `log_prob(wi, wo)`, solid angles; what is shown is mass per unit of log theta_h and of theta_d.
    """
    figure = Figure(figsize=(10, 4), layout="constrained")
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    theta_h, _, theta_d, _ = to_half_diff(samples.wi, samples.wo)
    left.plot(np.degrees(theta_h), np.degrees(theta_d), ".", ms=2, alpha=0.4)
    log_h, theta_d, mass = marginal(density)
    right.pcolormesh(
        np.degrees(np.exp(log_h)), np.degrees(theta_d), mass.T, shading="nearest", cmap="magma", norm=PowerNorm(0.5)
    )
    left.set(xscale="log", xlim=(0.03, 90), ylim=(0, 90), ylabel="θd / degrees", title="measured")
    right.set(title="the flow's density, its root as brightness")
    for axes in (left, right):
        axes.set_xlabel("θh / degrees")
    return figure


def marginal(density) -> tuple[Array, Array, Array]:
    """log theta_h (160,), theta_d (120,), and the density over the two, (160, 120)."""
    log_h = np.log(np.radians(np.geomspace(0.03, 90, FINE[0])))
    theta_d = np.pi / 2 * (np.arange(FINE[1]) + 0.5) / FINE[1]
    h, d, p = (a.ravel() for a in np.meshgrid(np.exp(log_h), theta_d, PHI_D, indexing="ij"))
    wi, wo = from_half_diff(h, np.zeros_like(h), d, p)
    value = np.zeros(len(h))
    up = above_horizon(wi, wo)
    # dwi dwo = 4 cos theta_d sin theta_d sin theta_h …, and theta_h dlog theta_h = dtheta_h
    measure = 4 * np.cos(d) * np.sin(d) * np.sin(h) * h
    value[up] = np.exp(density.log_prob(wi[up], wo[up])) * measure[up]
    return log_h, theta_d, value.reshape(*FINE, len(PHI_D)).mean(2)
