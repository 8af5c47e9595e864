"""What there is to say of a rig's parts, in lines for people: where the arms are, what is on, what is wrong."""

from typing import Any

import numpy as np

from gonio.rig.devices import Rig, Visited


def pose_deg(rig: Rig, seen: Visited | None = None) -> dict[str, float] | None:
    """Angle of every axis: as recorded with the last measurement, or as the encoders say. To be asked by the rig's
    own thread only, as it may touch the bus."""
    config = getattr(rig, "config", None)
    if config is None:
        return None
    raw = seen.raw[-1] if seen is not None and len(seen.raw) else {}
    if "pose_rad" in raw:
        pose = raw["pose_rad"]
    elif (stage := getattr(rig, "stage", None)) is not None:
        pose = stage.pose()
    else:
        pose = rig.state().get("pose")
    if pose is None:
        return None
    return {name: round(float(a), 3) for name, a in zip(config.axis_names, np.degrees(pose))}


def devices(rig: Rig) -> list[dict[str, Any]]:
    """Rows `name, ok, text`. May touch the bus: for the rig's own thread. Raises DeviceFault."""
    stage = getattr(rig, "stage", None)
    rows = []
    if stage is None:
        return [_row("rig", True, "ideal: no devices")]
    rows.append(_stage(stage))
    rows.append(_row("light", True, "simulated" if rig.simulated else "real"))
    drift = getattr(getattr(rig, "levels", None), "drift", 1.0)
    rows.append(_row("detector", True, f"drift {drift - 1:+.2%}"))
    for kind in ("geometry", "radiometry"):
        found = rig.calibration_ids.get(kind)
        rows.append(_row(kind, found is not None or rig.simulated, found or "nominal"))
    return rows


def _stage(stage: Any) -> dict[str, Any]:
    """Servos that can be asked for their state also tell supply and temperature."""
    text = "homed" if stage.homed else "not homed: run `gonio home`"
    if not callable(ask := getattr(stage, "states", None)):
        return _row("stage", stage.homed, text)
    states = ask()
    volts, celsius = min(s.volts for s in states), max(s.celsius for s in states)
    well = stage.homed and not any(s.hardware for s in states)
    return _row("stage", well, f"{text}, {volts:.1f} V, warmest servo {celsius} °C")


def _row(name: str, ok: bool, text: str) -> dict[str, Any]:
    return {"name": name, "ok": bool(ok), "text": text}
