"""The date and the id of a calibration: kind, day, and a few digits of what was found."""

import datetime as dt
import hashlib
import json
from typing import Any


def stamp(kind: str, found: dict[str, Any], rig: str, simulated: bool) -> dict[str, Any]:
    """Fields that every calibration file begins with."""
    digest = hashlib.sha256(json.dumps(found, sort_keys=True, default=str).encode()).hexdigest()[:6]
    now = dt.datetime.now(dt.UTC).replace(microsecond=0)
    return {"id": f"{kind}-{now:%Y%m%d}-{digest}", "date": now, "rig": rig, "simulated": simulated}
