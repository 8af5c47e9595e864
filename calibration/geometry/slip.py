"""What could be wrong where no rig explains the peaks: an axis whose zero slipped half-way."""

from collections.abc import Sequence

import numpy as np

from calibration.geometry.fit import Fit, Residual, fit_geometry
from calibration.geometry.observations import Observation
from gonio.geometry import Array

AGREES = 3.0  # times its noise: a fit that explains what it is made of
EXPLAINS = 0.25  # of the cost may be left
FEWEST = 18  # peaks that could disagree at all
EVALUATIONS = 25  # of one trial fit


def slipped(observations: Sequence[Observation], fit: Fit) -> str:
    """A sentence: the axis that moved on its shaft, by how much and when, if that explains the misses.

    When: the most peaks from the first on that one rig explains (bisection). Which and by how much: a fit with the slip
    as one parameter more, for each axis.
    """
    names = fit.parameters.config.axis_names
    k = _agreeing(observations, fit)
    trials = [_with_slip(observations, fit, axis, k) for axis in range(len(names))]
    best = int(np.argmin([cost for cost, _ in trials]))
    cost, turn = trials[best]
    if cost < EXPLAINS * _cost(observations, fit):
        return (
            f"{names[best]} seems to have slipped by {np.degrees(turn):+.1f} degrees near peak {k + 1}: "
            "tighten it on its shaft and calibrate again"
        )
    return "is everything tight, and the mirror flat? --force saves it all the same"


def _agreeing(observations: Sequence[Observation], fit: Fit) -> int:
    """How many peaks, from the first on, one rig explains."""
    low, high = FEWEST, len(observations)
    while high - low > 1:
        middle = (low + high) // 2
        part = fit_geometry(observations[:middle], fit.parameters, evaluations=EVALUATIONS)
        low, high = (middle, high) if part.excess < AGREES else (low, middle)
    return low


def _with_slip(observations: Sequence[Observation], fit: Fit, axis: int, k: int) -> tuple[float, float]:
    """Cost of the best fit with a slip of an axis before peak k; and by how much, rad, the encoder shows more since."""
    from scipy.optimize import least_squares

    residual = Residual(observations, fit.parameters, 1.0)
    poses, since = residual.poses.copy(), np.zeros_like(residual.poses)
    since[k:, axis] = 1.0

    def misses(p: Array) -> Array:
        residual.poses = poses - p[-1] * since
        return residual(p[:-1])

    scale = np.append(fit.parameters.prior, np.radians(1.0))
    found = least_squares(misses, np.zeros(len(scale)), x_scale=scale, max_nfev=EVALUATIONS)
    return float(found.cost), float(found.x[-1])


def _cost(observations: Sequence[Observation], fit: Fit) -> float:
    return float(0.5 * (Residual(observations, fit.parameters, 1.0)(fit.p) ** 2).sum())
