"""Dark and flat frames and bad pixels of the camera on a rig.

Dark: the lamp is off, the room dark or the lens capped. Flat: a diffuser before the lens, so that all pixels are lit
alike; the lamp is on. The flat is measured with the dark frames that the rig's YAML names.
"""

import datetime as dt
import hashlib
from contextlib import nullcontext
from dataclasses import replace

from gonio.rig.errors import CalibrationMissing
from gonio.rig.signal.frames import Frames
from gonio.rig.staged import StagedRig


def measure_frames(rig: StagedRig, *, flat: bool) -> Frames:
    """The frames of a rig whose detector is a camera; the light is off afterwards.

    Before a simulated camera a diffuser is held where one is needed. Raises CalibrationMissing, DeviceFault.
    """
    if rig.config.detector != "camera":
        raise CalibrationMissing(f"rig {rig.config.name}: its detector is a photodiode, which has no frames")
    if flat and rig.config.calibration.frames is None and not rig.simulated:
        raise CalibrationMissing("camera: measure its dark frames first, and name the file as calibration.frames")
    camera = rig.detector.camera  # type: ignore[attr-defined]
    rig.light.off()
    if rig.config.calibration.frames is None or not flat:
        camera.learn_dark()
    if flat:
        even = getattr(camera.source, "even", nullcontext)  # before a real one, the operator holds it
        try:
            rig.light.on()
            with even(camera.middle_exposure):
                camera.learn_flat()
        finally:
            rig.light.off()
    found: Frames = camera.known()
    now = dt.datetime.now(dt.UTC).replace(microsecond=0)
    flat_bytes = b"" if found.flat is None else found.flat.tobytes()
    digest = hashlib.sha256(found.dark.tobytes() + flat_bytes).hexdigest()[:6]
    return replace(found, id=f"frames-{now:%Y%m%d}-{digest}", date=now.isoformat())
