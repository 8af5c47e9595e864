"""Geometry by least squares: the rig that shows what was observed, and how well it is known.

The sample's frame is that of the boards where there are any; else mirror 0 lies as the sample does, and its normal is
the sample's. Parameters: `parameters.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from calibration.geometry.observations import Observation
from calibration.geometry.parameters import Parameters
from calibration.stamp import stamp
from gonio.config.rig import RigConfig
from gonio.geometry import Array, half_vector, unit
from gonio.rig.calibration import GeometryCalibration
from gonio.rig.errors import CalibrationMissing
from gonio.rig.kinematics.base import Kinematics

SIGMA = 3.5e-4  # rad, of a direction, where an observation does not say
DRAWS, POSES = 24, 300  # of rigs that could be as well, and of poses at which they are compared
SMALL = ("turn", "backlash", "centre", "height", "lie")  # what a table of a few observations need not tell
MANY, LEAST_EXCESS = (
    40.0,
    0.3,
)  # degrees of freedom that say how sure readings are, down to this share of what they state
WORST = np.radians(2.0)  # that observations may disagree by


@dataclass(frozen=True)
class Fit:
    """Parameters p (P,), their covariance (P, P), and what is left: `misses` (N, 3) of the directions seen, rad.

    rms: of the misses, rad; excess: in units of the stated sigmas, 1 where these are right.
    """

    parameters: Parameters
    p: Array
    covariance: Array
    misses: Array
    rms: float
    excess: float

    @cached_property
    def kinematics(self) -> Kinematics:
        return self.parameters.kinematics(self.p)

    @property
    def sigma(self) -> Array:
        """Of each parameter (P,)."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @cached_property
    def directions_sigma(self) -> float:
        """Root mean square, rad, by which a direction at a random pose may be off; a turn of all about the normal,
        which nothing but a mark on the sample tells, not counted."""
        rng = np.random.default_rng(0)
        poses = random_poses(self.parameters.config, POSES, rng)
        draws = rng.multivariate_normal(self.p, self.covariance, DRAWS, method="eigh")
        off = np.concatenate([apart(self.kinematics, self.parameters.kinematics(d), poses) for d in draws])
        return float(np.sqrt(np.mean(off**2)))


def fit_geometry(
    observations: Sequence[Observation],
    parameters: Parameters,
    start: Array | None = None,
    sigma: float = SIGMA,
    evaluations: int = 60,
) -> Fit:
    """The rig that explains the observations best, each good to its own sigma or to `sigma` rad.

    evaluations: at most; a rig that explains them is found in ten, one that does not creeps along for hundreds.
    """
    from scipy.optimize import least_squares

    residual = Residual(observations, parameters, sigma)
    fit = least_squares(
        residual, np.zeros(len(parameters)) if start is None else start, x_scale=parameters.prior, max_nfev=evaluations
    )
    seen = fit.fun[len(parameters) :].reshape(-1, 3)
    # three components stand for two degrees of freedom; what priors hold takes none away
    told = float(len(parameters) - np.trace(np.linalg.inv(fit.jac.T @ fit.jac) / parameters.prior**2))
    freedom = max(2 * len(observations) - told, 1.0)
    excess = float(np.sqrt((seen**2).sum() / freedom))
    # what is told by observations is as sure as they agree; the priors stay what they are
    scale = max(excess, LEAST_EXCESS if freedom >= MANY else 1.0)
    held = np.diag(parameters.prior**-2)
    covariance = np.linalg.inv((fit.jac.T @ fit.jac - held) / scale**2 + held)
    misses = seen * residual.sigma[:, None]
    rms = float(np.sqrt((misses**2).sum() / freedom))
    return Fit(parameters, fit.x, covariance, misses, rms, excess)


def calibrate_geometry(
    observations: Sequence[Observation], config: RigConfig, sigma: float = SIGMA, simulated: bool = False
) -> GeometryCalibration:
    """The calibration that a table of observations gives: offsets and tilts, all else where these do not suffice.

    Raises CalibrationMissing where there are too few of them, or where no geometry explains them.
    """
    names = config.axis_names
    if 2 * len(observations) < 3 * len(names) + 2:
        raise CalibrationMissing(f"geometry: {len(observations)} observations are too few; {3 * len(names)} would do")
    boards = any(o.kind != "mirror" for o in observations)
    mirrors = max((o.mirror for o in observations), default=0) + boards
    observations = [_moved(o, boards) for o in observations]
    level = (np.array([0.0, 0.0, 1.0]),) * mirrors
    fit = fit_geometry(observations, Parameters(config, level, held=SMALL if boards else SMALL[:-1]), sigma=sigma)
    if fit.excess > 1.3:  # offsets and tilts alone do not explain what was seen
        whole = fit_geometry(observations, Parameters(config, level), fit.p, sigma)
        fit = whole if whole.excess < 0.7 * fit.excess else fit
    if fit.rms > WORST:
        raise CalibrationMissing(
            f"geometry: the observations disagree by {np.degrees(fit.rms):.1f} degrees; check names and signs"
        )
    return calibration_of(fit, config, simulated)


def calibration_of(fit: Fit, config: RigConfig, simulated: bool, held_out: float | None = None) -> GeometryCalibration:
    """What is saved of a fit."""
    q = fit.parameters
    sigmas = np.degrees(q.of(fit.sigma, "offset")).tolist()
    found: dict[str, Any] = {
        **q.fields(fit.p),
        "offsets_sigma_deg": dict(zip(config.axis_names, sigmas)),
        "residual_deg": float(np.degrees(fit.rms)),
        "held_out_deg": None if held_out is None else float(np.degrees(held_out)),
        "directions_sigma_deg": float(np.degrees(fit.directions_sigma)),
        "parameters": dict(zip(q.names, fit.p.tolist())),
        "covariance": tuple(tuple(float(f"{v:.6g}") for v in row) for row in fit.covariance),
    }
    return GeometryCalibration(**stamp("geometry", found, config, simulated), **found)


def misses_of(observations: Sequence[Observation], fit: Fit) -> Array:
    """By how much (N,) observations that the fit has not seen miss it, rad."""
    residual = Residual(observations, fit.parameters, SIGMA)
    return np.asarray(np.linalg.norm(residual.seen(fit.p), axis=1))


class Residual:
    """Priors (P,) and misses (N, 3), in units of their sigmas, in one row."""

    def __init__(self, observations: Sequence[Observation], parameters: Parameters, sigma: float):
        self.parameters = parameters
        self.poses = np.array([o.pose for o in observations]).reshape(len(observations), -1)
        self.down = np.array([np.zeros(self.poses.shape[1], bool) if o.down is None else o.down for o in observations])
        self.sigma = np.array([sigma if o.sigma is None else o.sigma for o in observations])
        self.kinds = np.array([o.kind for o in observations])
        self.mirrors = [o.mirror for o in observations]
        self.directions = np.array([np.zeros(3) if o.direction is None else o.direction for o in observations])

    def seen(self, p: Array) -> Array:
        """What the rig shows less what was seen (N, 3)."""
        q = self.parameters
        wi, wo = q.kinematics(p).forward(self.poses + self.down * q.of(p, "backlash"))
        normals = np.array([q.normal(p, j) for j in range(len(q.mirrors) + 1)])
        shown = np.where((self.kinds == "detector")[:, None], wo, wi)
        of_mirror = half_vector(wi, wo) - normals[self.mirrors]
        return np.where((self.kinds == "mirror")[:, None], of_mirror, shown - self.directions)

    def __call__(self, p: Array) -> Array:
        return np.concatenate([p / self.parameters.prior, (self.seen(p) / self.sigma[:, None]).ravel()])


def _moved(o: Observation, boards: bool) -> Observation:
    """Beside boards no mirror lies as the sample does."""
    return Observation(o.kind, o.pose, o.direction, o.sigma, o.down, o.mirror + (boards and o.kind == "mirror"))


def random_poses(config: RigConfig, n: int, rng: np.random.Generator) -> Array:
    """Poses (n, A) within the limits of the axes, 80 degrees to either side at most on arms."""
    low, high = (np.array([getattr(config.axes[a], k) for a in config.axis_names]) for k in ("lower_deg", "upper_deg"))
    return np.radians(rng.uniform(np.maximum(low, -180), np.minimum(high, 180), (n, len(low))) * 0.9)


def apart(a: Kinematics, b: Kinematics, poses: Array) -> Array:
    """Angles between the directions that two rigs show, where both are above the horizon, after the turn about the
    normal that serves best."""
    (ai, ao), (bi, bo) = a.forward(poses), b.forward(poses)
    first, second = np.concatenate([ai, ao]), np.concatenate([bi, bo])
    up = (first[:, 2] > 0) & (second[:, 2] > 0)
    first, second = first[up], second[up]
    cross = (second[:, 0] * first[:, 1] - second[:, 1] * first[:, 0]).sum()
    angle = np.arctan2(cross, (first[:, :2] * second[:, :2]).sum())
    c, s = np.cos(angle), np.sin(angle)
    turned = second @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    gap = np.linalg.norm(unit(turned) - first, axis=1)
    return np.asarray(2 * np.arcsin(gap / 2))
