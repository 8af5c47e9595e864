"""Camera: pinhole and distortion from views of a ChArUco board (Zhang 2000, as in OpenCV >= 4.7 and 5).

Print the board with `board_image`, measure its squares, take 15 views or more that fill the frame and tilt the board by
20 to 45 degrees.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibration.board import FEWEST_CORNERS, Corners, Image
from calibration.stamp import stamp
from gonio.rig.calibration import CameraCalibration
from gonio.rig.errors import CalibrationMissing

FEWEST_VIEWS = 6


def calibrate_camera(
    corners: Sequence[Corners | None], size: tuple[int, int], rig: str, simulated: bool = False
) -> CameraCalibration:
    """The camera of pictures of size (width, height). Raises CalibrationMissing where too few show the board."""
    import cv2

    good = [c for c in corners if c is not None]
    if len(good) < FEWEST_VIEWS:
        raise CalibrationMissing(
            f"camera: {len(good)} of {len(corners)} views show {FEWEST_CORNERS} corners or more, {FEWEST_VIEWS} are "
            "needed; take sharper views that fill the frame"
        )
    objects, images = [c.on_board for c in good], [c.in_view for c in good]
    rms, matrix, distortion, _, _ = cv2.calibrateCamera(objects, images, size, None, None)  # type: ignore[call-overload]
    found: dict[str, Any] = {
        "matrix": matrix.tolist(),
        "distortion": distortion.ravel().tolist(),
        "size": size,
        "rms_px": float(rms),
        "views": len(good),
    }
    return CameraCalibration(**stamp("camera", found, rig, simulated), **found)


def read_views(paths: Sequence[Path]) -> list[Image]:
    """Grey images of files. Raises CalibrationMissing that names the one that cannot be read or is of another size."""
    import cv2

    views: list[Image] = []
    for path in paths:
        view = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if view is None:
            raise CalibrationMissing(f"{path}: not an image that can be read; take PNG or JPEG")
        if views and view.shape != views[0].shape:
            raise CalibrationMissing(
                f"{path}: {view.shape[1]} x {view.shape[0]} pixels, unlike the first; leave it out"
            )
        views.append(np.asarray(view, np.uint8))
    return views
