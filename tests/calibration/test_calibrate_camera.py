"""A synthetic camera is found again from its views of a board."""

import numpy as np
import pytest

from calibration.camera import Board, board_image, calibrate_camera, find_corners, read_views
from gonio.rig.calibration import CameraCalibration, load_calibration, save_calibration
from gonio.rig.errors import CalibrationMissing

cv2 = pytest.importorskip("cv2")
MATRIX = np.array([[1100.0, 0, 655], [0, 1100, 348], [0, 0, 1]])
SIZE = (1280, 720)


def views(n, board, seed=0):
    """Views of the board by homography: plane (x, y, 0) -> K [r1 r2 t]."""
    rng = np.random.default_rng(seed)
    picture = board_image(board, 80)
    margin = 40
    picture = cv2.copyMakeBorder(picture, margin, margin, margin, margin, cv2.BORDER_CONSTANT, value=255)
    to_plane = np.array([[board.square / 80, 0, 0], [0, board.square / 80, 0], [0, 0, 1.0]])
    to_plane[:2, 2] = -(margin - 0.5 + 0.5) * board.square / 80
    for _ in range(n):
        turn, _ = cv2.Rodrigues(rng.uniform(-0.6, 0.6, 3) * [1, 1, 0.3])
        centre = np.array([board.across, board.down, 0]) * board.square / 2
        shift = np.array([rng.uniform(-0.05, 0.05), rng.uniform(-0.03, 0.03), rng.uniform(0.28, 0.4)]) - turn @ centre
        homography = MATRIX @ np.column_stack([turn[:, 0], turn[:, 1], shift]) @ to_plane
        view = cv2.warpPerspective(picture, homography, SIZE, flags=cv2.INTER_AREA, borderValue=128)
        view = cv2.GaussianBlur(view, (0, 0), 0.7) + rng.normal(0, 2, (SIZE[1], SIZE[0]))
        yield np.clip(view, 0, 255).astype(np.uint8)


def test_camera_is_found(tmp_path):
    found = calibrate_camera(find_corners(list(views(14, Board())), Board()), SIZE, "bench", simulated=True)
    assert found.rms_px < 0.5 and found.views >= 12 and found.size == SIZE
    np.testing.assert_allclose(np.array(found.matrix)[[0, 1], [0, 1]], 1100, rtol=0.01)
    np.testing.assert_allclose(np.array(found.matrix)[:2, 2], MATRIX[:2, 2], atol=10)
    path = save_calibration(found, tmp_path / "made")
    assert load_calibration(path, CameraCalibration) == found and path.stem == found.id


def test_too_few_views(tmp_path):
    blank = [np.full((720, 1280), 128, np.uint8)] * 8
    with pytest.raises(CalibrationMissing, match="0 of 8 views"):
        calibrate_camera(find_corners(blank, Board()), SIZE, "bench")
    (tmp_path / "x.png").write_bytes(b"no image")
    with pytest.raises(CalibrationMissing, match=r"x\.png: not an image"):
        read_views([tmp_path / "x.png"])
    with pytest.raises(ValueError, match="odd"):
        Board(across=6)
