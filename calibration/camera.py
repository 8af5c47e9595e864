"""Camera: pinhole and distortion from views of a ChArUco board (Zhang 2000, as in OpenCV >= 4.7 and 5).

Print the board with `board_image`, measure its squares, take 15 views or more that fill the frame and tilt the board by
20 to 45 degrees. An odd count of squares on both sides avoids the pattern change of OpenCV 4.6.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calibration.stamp import stamp
from gonio.geometry import Array
from gonio.rig.calibration import CameraCalibration
from gonio.rig.errors import CalibrationMissing

Image = NDArray[np.uint8]
FEWEST_CORNERS, FEWEST_VIEWS = 8, 6


@dataclass(frozen=True)
class Board:
    """A ChArUco board: squares across and down (odd), their side and that of the markers in metres."""

    across: int = 7
    down: int = 5
    square: float = 0.03
    marker: float = 0.022

    def __post_init__(self) -> None:
        if self.across % 2 == 0 or self.down % 2 == 0:
            raise ValueError(f"board of {self.across} x {self.down}: take odd counts; even ones are ambiguous")

    def charuco(self) -> Any:
        from cv2 import aruco

        dictionary = aruco.getPredefinedDictionary(aruco.DICT_4X4_50)
        return aruco.CharucoBoard((self.across, self.down), self.square, self.marker, dictionary)


def board_image(board: Board, pixels_per_square: int = 120) -> Image:
    """The board to print, 8-bit grey, without margin."""
    return board.charuco().generateImage((board.across * pixels_per_square, board.down * pixels_per_square))


@dataclass(frozen=True)
class Corners:
    """Corners of the board that one view shows: (N, 3) metres on the board, (N, 2) pixels."""

    on_board: Array
    in_view: Array


def find_corners(views: Sequence[Image], board: Board) -> list[Corners | None]:
    """Of each grey view (H, W); None where it shows too few of them."""
    import cv2

    charuco = board.charuco()
    detector = cv2.aruco.CharucoDetector(charuco)
    found: list[Corners | None] = []
    for view in views:
        corners, ids, _, _ = detector.detectBoard(view)
        if ids is None or len(ids) < FEWEST_CORNERS:
            found.append(None)
            continue
        on_board, in_view = charuco.matchImagePoints(corners, ids)
        found.append(Corners(np.asarray(on_board, np.float32).reshape(-1, 3), np.asarray(in_view).reshape(-1, 2)))
    return found


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
