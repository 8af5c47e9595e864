"""Calibrations that are no longer to be believed: too old, of another rig, of a rig since changed, of another room."""

import datetime as dt
import hashlib
import json
from pathlib import Path
from typing import Any

from gonio.config.rig import RigConfig
from gonio.rig.calibration import (
    CameraCalibration,
    Dated,
    GeometryCalibration,
    RadiometryCalibration,
    load_calibration,
)
from gonio.rig.errors import CalibrationMissing

AHEAD = dt.timedelta(minutes=10)  # that a clock may be wrong by
KINDS: dict[str, type[Dated]] = {
    "geometry": GeometryCalibration,
    "radiometry": RadiometryCalibration,
    "camera": CameraCalibration,
}
MAKE = {"geometry": "geometry --mirror", "radiometry": "radiometry", "camera": "camera"}
# what each hangs on in a rig's YAML
PARTS: dict[str, Any] = {
    "geometry": {"kinematics": True, "axes": {"__all__": {"counts_per_turn", "offset_deg", "backlash_deg"}}},
    "radiometry": {
        "detector": True,
        "exposure_s": True,
        "photodiode": {"bits", "ranges", "range_factor", "full_scale", "footprint"},
        "acceptance": True,
    },
    "camera": {"kinematics": True, "camera": {"width", "height"}},
}


def made_for(kind: str, config: RigConfig) -> str:
    """Digest of the parts of a rig that a calibration of this kind hangs on."""
    parts = config.model_dump(mode="json", include=PARTS[kind])
    if isinstance(parts.get("detector"), dict):  # the same instrument on another port is the same
        parts["detector"] = {k: v for k, v in parts["detector"].items() if k not in ("port", "boot_s")}
        if isinstance(instrument := parts["detector"].get("instrument"), dict):
            parts["detector"]["instrument"] = {k: v for k, v in instrument.items() if k not in ("source", "boot_s")}
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:12]


def stale(config: RigConfig) -> dict[str, str]:
    """Kind -> why its calibration is not to be believed. Raises CalibrationMissing where a file is missing or
    damaged."""
    found = {}
    for kind, model in KINDS.items():
        name = getattr(config.calibration, kind)
        if name is not None:
            why = _why(kind, load_calibration(Path(name), model), config)
            if why is not None:
                found[kind] = f"{name}: {why}"
    return found


def refuse_stale(config: RigConfig) -> None:
    """Raises CalibrationMissing that says which, why, and the command; unless the rig allows it."""
    for kind, why in ({} if config.calibration.allow_stale else stale(config)).items():
        raise CalibrationMissing(
            f"{why}; make it anew with `gonio calibrate {MAKE[kind]} --rig ...`, "
            "or measure all the same with --allow-stale"
        )


def _why(kind: str, c: Dated, config: RigConfig) -> str | None:
    limits = config.calibration
    age = dt.datetime.now(dt.UTC) - c.date.astimezone(dt.UTC)
    if age < -AHEAD:
        return f"dated {-age.total_seconds() / 3600:.1f} hours ahead of this machine's clock; set the clock"
    if limits.max_age_days is not None and age > dt.timedelta(days=limits.max_age_days):
        return f"{age.days} days old, the rig allows {limits.max_age_days:g}"
    if c.rig not in (config.name, "-"):
        return f"made on rig {c.rig}, this is {config.name}"
    if c.made_for is not None and c.made_for != made_for(kind, config):
        return "the rig's YAML was changed since in what it hangs on"
    if c.temperature_c is not None and limits.temperature_c is not None:
        change = limits.temperature_c - c.temperature_c
        if abs(change) > limits.max_change_k:
            return f"made at {c.temperature_c:g} degrees C, the room is at {limits.temperature_c:g}"
    return None
