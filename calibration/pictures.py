"""Pictures of a calibration, each a function of what was found that returns a matplotlib Figure."""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from calibration.geometry.fit import Fit
from calibration.geometry.observations import Observation
from calibration.radiometry.session import Session
from gonio.atomic import beside
from gonio.geometry import Array
from gonio.rig.calibration import RadiometryCalibration


def save(figure: Figure, path: Path) -> None:
    """As PNG, whole or not at all."""
    with beside(path) as part:
        figure.savefig(part, dpi=100, format="png")


def geometry(fit: Fit, observations: list[Observation], held_out: Array) -> Figure:
    """What is left at each peak, as vectors over the plane of half vectors; from above and from below; every sigma."""
    figure = Figure(figsize=(13, 4.2), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    _residual_vectors(left, fit, observations)
    _both_sides(middle, fit, observations)
    _sigmas(right, fit)
    if len(held_out):
        figure.suptitle(
            f"{len(observations)} peaks, {np.degrees(fit.rms):.4f}° left; {len(held_out)} held out, "
            f"{np.degrees(np.sqrt(np.mean(held_out**2))):.4f}°; a direction is known to "
            f"{np.degrees(fit.directions_sigma):.3f}°"
        )
    return figure


def _residual_vectors(axis, fit: Fit, observations: list[Observation]) -> None:
    poses = np.degrees([o.pose for o in observations])
    names = fit.parameters.config.axis_names
    x, y = poses[:, 0], poses[:, 1]
    miss = np.degrees(fit.misses[:, :2])
    colours = [o.mirror for o in observations]
    arrows = axis.quiver(x, y, *miss.T, colours, cmap="coolwarm", angles="xy", width=0.004)
    size = float(f"{max(np.abs(miss).max(), 1e-6):.1g}")
    axis.quiverkey(arrows, 0.85, 1.04, size, f"{size:g}°", labelpos="E")
    axis.set(xlabel=f"{names[0]} [deg]", ylabel=f"{names[1]} [deg]")
    axis.set_title("what is left, by mirror", loc="left", fontsize=10)


def _both_sides(axis, fit: Fit, observations: list[Observation]) -> None:
    """Backlash of each axis as fitted, and how many peaks were approached from above on it."""
    q = fit.parameters
    value, sigma = np.degrees(q.of(fit.p, "backlash")), np.degrees(q.of(fit.sigma, "backlash"))
    above = np.sum([o.down for o in observations if o.down is not None], 0)
    names = [f"{n}\n({int(k)} from above)" for n, k in zip(q.config.axis_names, np.broadcast_to(above, len(value)))]
    axis.errorbar(np.arange(len(value)), value, 2 * sigma, fmt="o", capsize=4)
    axis.axhline(0, color="0.7", lw=1)
    axis.set_xticks(np.arange(len(value)), names, fontsize=8)
    axis.set_ylabel("backlash [deg], two σ")
    axis.set_title("from above against from below", loc="left", fontsize=10)


def _sigmas(axis, fit: Fit) -> None:
    q = fit.parameters
    order = np.arange(len(q))[::-1]
    axis.barh(order, np.degrees(q.prior), color="0.9", label="before")
    axis.barh(order, np.degrees(fit.sigma), color="C0", label="after")
    axis.set_xscale("log")
    axis.set_yticks(order, q.names, fontsize=5)
    axis.set_xlabel("σ [deg; 1/57 arm]")
    axis.legend(fontsize=8, loc="upper right")


def radiometry(session: Session, found: RadiometryCalibration) -> Figure:
    """Photon transfer, what the curve leaves over the decades, the lamp's drift, the gain by angle."""
    figure = Figure(figsize=(13, 7), layout="constrained")
    (first, second), (third, fourth) = figure.subplots(2, 2)
    _transfer(first, session, found)
    _linearity(second, session)
    steady = session.steady
    third.plot(steady.times / 60, 100 * (steady.signals - 1), ".", ms=3)
    third.plot(steady.times / 60, 100 * steady.drift * steady.times, color="k", lw=1)
    third.set(xlabel="minutes", ylabel="lamp [%]")
    third.set_title(f"{found.drift_per_h:+.2%} an hour", loc="left", fontsize=10)
    gains = np.array([g for _, g, _, _ in session.angles]) / np.array(found.gain)
    sigmas = np.array([s for _, _, s, _ in session.angles]) / np.array(found.gain)
    for c in range(gains.shape[1]):
        fourth.errorbar(
            np.arange(len(gains)) + 0.1 * c, 100 * (gains[:, c] - 1), 200 * sigmas[:, c], fmt="o", capsize=3
        )
    fourth.set(xlabel="angle of the certificate", ylabel="gain beside its mean [%], two σ")
    return figure


def _transfer(axis, session: Session, found: RadiometryCalibration) -> None:
    for p in session.points:
        if p.n >= 8:
            light = p.value - session.dark[0] - session.dark[1] * p.seconds
            axis.plot(light, p.scatter**2, ".", color="C0")
    line = np.geomspace(1e-5, 1e3, 100)
    assert found.shot_noise is not None and found.read_noise is not None
    axis.plot(line, found.read_noise**2 + found.shot_noise**2 * line, color="k", lw=1)
    axis.set(xscale="log", yscale="log", xlabel="light", ylabel="variance of a reading")
    axis.set_title("photon transfer", loc="left", fontsize=10)


def _linearity(axis, session: Session) -> None:
    value = np.array([p.value for p in session.points])
    noise = np.array([p.sigma for p in session.points]) / np.maximum(np.abs(value), 1e-300)
    levels = np.array([p.level for p in session.points])
    for level in np.unique(levels):
        which = levels == level
        axis.errorbar(
            value[which].ravel(),
            100 * session.curve.off[which].ravel(),
            200 * noise[which].ravel(),
            fmt=".",
            label=f"lamp {level}",
        )
    axis.set(xscale="log", xlabel="signal", ylabel="off the curve [%], two σ", ylim=(-2, 2))
    axis.set_title("linearity", loc="left", fontsize=10)
    axis.legend(fontsize=8)
