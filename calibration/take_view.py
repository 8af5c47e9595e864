"""A picture by the rig's own camera, of whatever lies in the sample's place, and the pose it was taken at."""

import csv
import io
from pathlib import Path

import numpy as np

from drivers.hdr import NEAR_SATURATION
from gonio.atomic import beside, write_text
from gonio.geometry import Array
from gonio.rig.errors import CalibrationMissing
from gonio.rig.staged import StagedRig

CLIPPED = 0.01  # share of pixels that a picture of a board may have near saturation


def take_view(rig: StagedRig, picture: Path, poses: Path) -> Array:
    """Write the picture, 8-bit grey, and add its pose to the table; the pose (A,). The light is off afterwards.

    Nothing moves. Raises CalibrationMissing where a file cannot be written, DeviceFault.
    """
    import cv2

    if rig.config.detector != "camera":
        raise CalibrationMissing(f"rig {rig.config.name}: its detector is a photodiode, which takes no pictures")
    camera = rig.detector.camera  # type: ignore[attr-defined]
    rig.light.on()
    rig.light.level(1)
    try:
        for t, dark in zip(camera.config.exposure_s[::-1], camera.known().dark[::-1]):
            frame = camera.frame(t)
            grey = np.maximum(frame - dark, 0).mean(-1)
            if (frame >= NEAR_SATURATION * camera.source.full_scale).mean() < CLIPPED:
                break
    finally:
        rig.light.off()
    pose = rig.stage.pose()
    scaled = np.clip(255 * grey / max(float(np.quantile(grey, 0.995)), 1.0), 0, 255).astype(np.uint8)
    head = ["view", *(f"{name}_deg" for name in rig.config.axis_names)]
    try:
        with beside(picture) as part:
            if not cv2.imwrite(str(part), scaled):
                raise OSError
        before = poses.read_text(encoding="utf-8") if poses.exists() else ""
        text = io.StringIO()
        row = [picture.name, *(f"{a:.4f}" for a in np.degrees(pose))]
        csv.writer(text, lineterminator="\n").writerows([row] if before.strip() else [head, row])
        write_text(poses, before + "\n" * (before != "" and before[-1] != "\n") + text.getvalue())
    except (OSError, UnicodeDecodeError, cv2.error):
        raise CalibrationMissing(
            f"{picture}, {poses}: cannot be written; name a .png in a folder that exists"
        ) from None
    return np.asarray(pose)
