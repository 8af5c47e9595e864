"""What an operator does by hand: home, park, jog, measure. The same from a daemon and from a command alone."""

import itertools
from typing import Any

import numpy as np

from gonio.config import ConfigError
from gonio.daemon.health import pose_deg
from gonio.daemon.rig_owner import RigOwner
from gonio.geometry import from_angles, to_angles

_numbers = itertools.count(1 << 41)  # of measurements that belong to no run


def home(owner: RigOwner) -> dict[str, Any]:
    """Confirm the zero of every axis."""
    rig = _arms(owner)
    rig.home()
    return {"pose_deg": pose_deg(rig)}


def park(owner: RigOwner) -> dict[str, Any]:
    """Light off, arms to their pose of rest."""
    rig = _arms(owner)
    rig.park()
    return {"pose_deg": pose_deg(rig)}


def jog(owner: RigOwner, axis: str, degrees: float) -> dict[str, Any]:
    """Turn one axis. Raises SafetyStop where that leads out of the limits or into the stay-out cone."""
    if axis not in owner.config.axis_names:
        raise ConfigError(f"{axis}: no such axis; they are {', '.join(owner.config.axis_names)}")
    rig = _arms(owner)
    rig.jog(axis, float(np.radians(degrees)))
    return {"pose_deg": pose_deg(rig)}


def measure(owner: RigOwner, angles_deg: tuple[float, float, float, float], truth: str | None) -> dict[str, Any]:
    """One reading at theta_i, phi_i, theta_o, phi_o: f and sigma in 1/sr, angles as achieved."""
    rig = owner.as_is(_open(truth))
    theta_i, phi_i, theta_o, phi_o = np.radians(angles_deg)
    wi, wo = from_angles(np.array([theta_i]), phi_i), from_angles(np.array([theta_o]), phi_o)
    if not rig.reachable(wi, wo)[0]:
        raise ConfigError(f"rig {owner.config.name}: that pair of directions is out of reach; `gonio check` shows more")
    seen = next(iter(rig.visit(wi, wo, np.array([next(_numbers)]))), None)
    if seen is None:
        return {"stopped": True}
    achieved = (np.degrees([*to_angles(seen.wi[0]), *to_angles(seen.wo[0])]).round(4) + 0.0).tolist()  # no -0
    return {
        "f": [float(v) if np.isfinite(v) else None for v in seen.f[0]],
        "sigma": [float(v) if np.isfinite(v) else None for v in seen.sigma[0]],
        "saturated": bool(seen.saturated[0]),
        **dict(zip(("theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg"), achieved)),
        "rig_s": round(float(seen.rig_s[0]), 3),
        "pose_deg": pose_deg(rig, seen),
    }


def _open(truth: str | None):
    if truth is None:
        return None
    from gonio.brdf.library import find
    from gonio.load import load_brdf

    return load_brdf(find(truth).path)


def _arms(owner: RigOwner) -> Any:
    if owner.config.depth == "ideal":
        raise ConfigError(f"rig {owner.config.name} is ideal and has no arms to move; take `sim`, or a real one")
    return owner.as_is(calibrated=False)
