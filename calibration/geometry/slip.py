"""What could be wrong where no rig explains the peaks: an axis whose zero slipped half-way."""

from collections.abc import Sequence

import numpy as np

from calibration.geometry.fit import Fit, Residual
from calibration.geometry.observations import Observation
from gonio.geometry import Array

EXPLAINS = 0.25  # of the squared misses may be left
STEP = 1e-5  # rad
SETTLED = 3  # peaks at least on either side of a slip


def slipped(observations: Sequence[Observation], fit: Fit) -> str:
    """A sentence: the axis that moved on its shaft, by how much and when, if that explains the misses.

    To first order: a slip of axis a before peak k adds one column to the linear problem; the best of all (a, k) is taken.
    """
    residual = Residual(observations, fit.parameters, 1.0)
    weight = np.repeat(1 / residual.sigma, 3)
    seen = lambda p: residual.seen(p).ravel() * weight
    steps = STEP * np.eye(len(fit.p))
    jacobian = np.stack([(seen(fit.p + s) - seen(fit.p - s)) / (2 * STEP) for s in steps], 1)
    misses, held = seen(fit.p), np.diag(1 / fit.parameters.prior)
    before = float((misses**2).sum())
    best = (np.inf, "", 0, 0.0)
    for axis, name in enumerate(fit.parameters.config.axis_names):
        turned = Residual([_turned(o, axis) for o in observations], fit.parameters, 1.0)
        column = (turned.seen(fit.p).ravel() * weight - misses) / STEP
        for k in range(SETTLED, len(observations) - SETTLED):
            slip = np.where(np.repeat(np.arange(len(observations)) >= k, 3), column, 0.0)
            left, turn = _solved(jacobian, slip, misses, held, fit.p / fit.parameters.prior)
            best = min(best, (left, name, k, turn))
    left, name, k, turn = best
    if left < EXPLAINS * before:
        return (
            f"{name} seems to have slipped by {np.degrees(turn):+.1f} degrees near peak {k + 1}: "
            "tighten it on its shaft and calibrate again"
        )
    return "is everything tight, and the mirror flat? --force saves it all the same"


def _turned(o: Observation, axis: int) -> Observation:
    pose = o.pose.copy()
    pose[axis] += STEP
    return Observation(o.kind, pose, o.direction, o.sigma, o.down, o.mirror)


def _solved(jacobian: Array, slip: Array, misses: Array, held: Array, pulled: Array) -> tuple[float, float]:
    """Squared misses left with the slip that serves best, and the slip, rad, by which encoders show more than before."""
    above = np.concatenate([jacobian, slip[:, None]], 1)
    below = np.concatenate([held, np.zeros((len(held), 1))], 1)
    step, *_ = np.linalg.lstsq(np.concatenate([above, below]), -np.concatenate([misses, pulled]), rcond=None)
    return float(((misses + above @ step) ** 2).sum()), -float(step[-1])
