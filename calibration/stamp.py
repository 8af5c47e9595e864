"""The date and the id of a calibration: kind, day, and a few digits of what was found."""

import datetime as dt
import hashlib
import json
from typing import Any

from gonio.config.rig import RigConfig
from gonio.rig.stale import made_for


def stamp(kind: str, found: dict[str, Any], rig: str | RigConfig, simulated: bool) -> dict[str, Any]:
    """Fields that every calibration file begins with; of a rig's config also what of it the calibration hangs on."""
    digest = hashlib.sha256(json.dumps(found, sort_keys=True, default=str).encode()).hexdigest()[:6]
    now = dt.datetime.now(dt.UTC).replace(microsecond=0)
    made = {"id": f"{kind}-{now:%Y%m%d}-{digest}", "date": now, "simulated": simulated}
    if isinstance(rig, str):
        return made | {"rig": rig}
    return made | {
        "rig": rig.name,
        "made_for": made_for(kind, rig),
        "temperature_c": rig.calibration.temperature_c,
    }
