"""Geometry: encoder offsets and tilts of the axes, from directions seen, by least squares.

Three kinds of observation at an encoder pose, whichever the lab can make:

    mirror     a flat mirror in the sample's place throws the light into the detector: the half vector is its normal
    detector   the camera on the detector arm sees a board in the sample's place: wo in the sample's frame
    light      a polished ball or the board's shadow gives wi in the sample's frame

The mirror's own normal need not be the sample's; it is found with the rest. What the observations cannot tell (the
turntable's zero from mirrors alone) is held near the drawing by weak priors: offsets 10 degrees, tilts 2 degrees.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from calibration.stamp import stamp
from gonio.config.rig import RigConfig
from gonio.geometry import Array, half_vector, unit
from gonio.rig.build import gantry_chain, gimbal_chain
from gonio.rig.calibration import GeometryCalibration
from gonio.rig.errors import CalibrationMissing
from gonio.rig.kinematics.chain import Chain
from gonio.rig.kinematics.offsets import Offsets

PRIOR_OFFSET, PRIOR_TILT = np.radians(10.0), np.radians(2.0)
NOMINAL = {
    "gantry": {"light": (0, 1, 0), "turntable": (0, 0, 1), "detector": (0, 1, 0), "azimuth": (0, 0, 1)},
    "gimbal": {"yaw": (0, 0, 1), "tilt": (0, -1, 0), "roll": (1, 0, 0), "detector": (0, 0, 1)},
}


@dataclass(frozen=True)
class Observation:
    """What was seen at an encoder pose (A,) rad: `direction` (3,) in the sample's frame, None for a mirror."""

    kind: Literal["mirror", "detector", "light"]
    pose: Array
    direction: Array | None = None


def calibrate_geometry(
    observations: Sequence[Observation], config: RigConfig, sigma: float = 3.5e-4, simulated: bool = False
) -> GeometryCalibration:
    """Offsets and tilted axes that explain the observations, each good to `sigma` rad.

    Raises CalibrationMissing where there are too few of them, or where no geometry explains them.
    """
    from scipy.optimize import least_squares

    kind = config.kinematics.kind
    if kind not in NOMINAL:
        raise CalibrationMissing(f"geometry: a {kind} is described joint by joint; put its axes into the rig's YAML")
    nominal = {name: np.array(axis, float) for name, axis in NOMINAL[kind].items()}
    names = config.axis_names
    if 2 * len(observations) < 3 * len(names) + 2:
        raise CalibrationMissing(f"geometry: {len(observations)} observations are too few; {3 * len(names)} would do")
    groups = {k: [o for o in observations if o.kind == k] for k in ("mirror", "detector", "light")}
    poses = {k: np.array([o.pose for o in group]) for k, group in groups.items() if group}
    seen = {k: np.array([o.direction for o in groups[k]]) for k in ("detector", "light") if groups[k]}

    def residual(p: Array) -> Array:
        rig, normal = _rig(p, kind, names, nominal)
        parts = [p[: len(names)] / PRIOR_OFFSET, p[len(names) :] / PRIOR_TILT]
        for what, at in poses.items():
            wi, wo = rig.forward(at)
            if what == "mirror":
                parts.append(((half_vector(wi, wo) - normal) / sigma).ravel())
            else:
                parts.append((((wo if what == "detector" else wi) - seen[what]) / sigma).ravel())
        return np.concatenate(parts)

    size = 3 * len(names) + 2
    fit = least_squares(residual, np.zeros(size), x_scale="jac")
    # three components stand for two degrees of freedom; the priors count for nothing here
    freedom = max(2 * len(observations) - size, 1)
    off = float(np.sqrt((fit.fun[size:] ** 2).sum() / freedom)) * sigma
    if off > np.radians(2):
        raise CalibrationMissing(
            f"geometry: the observations disagree by {np.degrees(off):.1f} degrees; check names and signs"
        )
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * max(off / sigma, 1.0) ** 2
    spread = np.degrees(np.sqrt(np.diag(covariance)))
    found: dict[str, Any] = {
        "offsets_deg": {n: float(np.degrees(fit.x[k])) for k, n in enumerate(names)},
        "offsets_sigma_deg": {n: float(spread[k]) for k, n in enumerate(names)},
        "axes": {n: tuple(a.tolist()) for n, a in _axes(fit.x, names, nominal).items()},
        "residual_deg": float(np.degrees(off)),
    }
    return GeometryCalibration(**stamp("geometry", found, config.name, simulated), **found)


def _rig(p: Array, kind: str, names: Sequence[str], nominal: dict[str, Array]) -> tuple[Offsets, Array]:
    """The rig of parameters p (3 A + 2,): offsets, two tilts per axis, the mirror's normal; and that normal."""
    build = gantry_chain if kind == "gantry" else gimbal_chain
    chain: Chain = build({n: a.tolist() for n, a in _axes(p, names, nominal).items()})
    return Offsets(chain, p[: len(names)]), unit(np.array([p[-2], p[-1], 1.0]))


def _axes(p: Array, names: Sequence[str], nominal: dict[str, Array]) -> dict[str, Array]:
    tilts = p[len(names) : 3 * len(names)].reshape(-1, 2)
    return {n: unit(nominal[n] + tilt @ _across(nominal[n])) for n, tilt in zip(names, tilts)}


def _across(axis: Array) -> Array:
    """Two unit vectors (2, 3) at right angles to a coordinate axis."""
    k = int(np.abs(axis).argmax())
    return np.eye(3)[[(k + 1) % 3, (k + 2) % 3]]
