"""A synthetic camera is found again from its views of a board."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from calibration.board import Board, Corners, board_image, contradiction, find_corners, flat_corners, recognised
from calibration.camera import calibrate_camera, read_views
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


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"dictionary": "DICT_9X9"}, "DICT_9X9: not one of DICT_4X4_100"),
        ({"across": 30, "down": 20}, "DICT_4X4_50: has 50 markers, 300 are needed"),
        ({"marker": 0.03}, "smaller than the squares"),
        ({"across": 1}, "at least 2 x 3"),
    ],
)
def test_boards_that_do_not_exist(keys, words):
    with pytest.raises(ValueError, match=words):
        Board(**keys)


BOUGHT = [
    Board(12, 9, 0.015, 0.011, "DICT_5X5_100"), Board(8, 6, 0.02, 0.015), Board(8, 6, 0.02, 0.015, legacy=True),
    Board(11, 8, 0.015, 0.011, "DICT_6X6_250", legacy=True),
]  # fmt: skip


@pytest.mark.parametrize("board", BOUGHT, ids=str)
def test_bought_boards_even_ones_too(board):
    found = calibrate_camera(find_corners(list(views(10, board)), board), SIZE, "bench")
    assert found.rms_px < 0.5 and found.views >= 8
    np.testing.assert_allclose(np.array(found.matrix)[[0, 1], [0, 1]], 1100, rtol=0.015)


@pytest.mark.slow
@pytest.mark.parametrize("board", [*BOUGHT, Board()], ids=str)
@pytest.mark.parametrize("wrong", [{"legacy": True}, {"swapped": True}, {"swapped": True, "legacy": True}, {}], ids=str)
def test_the_board_that_the_pictures_show_is_recognised(board, wrong):
    named = replace(board, legacy=board.legacy != wrong.get("legacy", False))
    if wrong.get("swapped"):
        named = replace(named, across=board.down, down=board.across)
    pictures = list(views(4, board))
    found = recognised(pictures, named)
    assert (found.across, found.down) == (board.across, board.down)
    assert found.legacy == board.legacy or board.down % 2  # of an odd count down both patterns are one


def test_ids_that_look_right_and_are_not_do_not_lie_on_a_plane():
    """Negative control: the corners of a 7 x 5 board by the numbers that a 5 x 7 board gives them."""
    (seen,) = find_corners(list(views(1, Board())), Board())
    swapped = Board(across=5, down=7)
    number = (np.rint(seen.on_board[:, :2] / Board().square) - 1) @ [1, Board().across - 1]
    place = swapped.charuco().getChessboardCorners()[number.astype(int)]
    assert flat_corners(seen, Board()) == len(number)
    assert flat_corners(Corners(place, seen.in_view), swapped) < 0.3 * len(number)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("named", "words"),
    [
        (Board(9, 6, 0.02, 0.015), "markers of DICT_4X4_50 are seen, but not as on a board of 9 x 6 squares"),
        (Board(8, 6, 0.02, 0.015, "DICT_5X5_50"), "but of DICT_4X4_50; call it --dictionary DICT_4X4_50"),
        (Board(8, 6, 0.02, 0.015), ""),
    ],
)
def test_a_board_that_is_another_is_said(named, words):
    pictures = list(views(3, Board(8, 6, 0.02, 0.015)))
    said = contradiction(pictures, named, find_corners(pictures, named))
    assert words in said and (words != "") == (said != "")


def test_corners_off_every_plane_are_not_fitted():
    (seen,) = find_corners(list(views(1, Board())), Board())
    torn = Corners(seen.on_board[::-1][np.argsort(seen.in_view[:, 0])], seen.in_view)
    assert "do not lie as on a board of 7 x 5" in contradiction([], Board(), [torn, None])
    blank = [np.full((720, 1280), 128, np.uint8)]
    assert contradiction(blank, Board(), [None]) == ""


def test_the_command_says_which_board_it_sees(tmp_path):
    board = Board(8, 6, 0.02, 0.015, legacy=True)
    names = [tmp_path / f"{k}.png" for k in range(8)]
    for name, view in zip(names, views(8, board)):
        cv2.imwrite(str(name), view)
    sides = ["--square-mm", "20", "--marker-mm", "15", "--out", tmp_path]
    command = [sys.executable, "-m", "gonio.cli", "calibrate", "camera", *names, *sides]
    run = lambda *words: subprocess.run([*map(str, command), *words], capture_output=True, text=True)
    swapped = run("--across", "6", "--down", "8")
    assert swapped.returncode == 5 and "8 x 6 squares, legacy pattern" in swapped.stderr
    assert "--across 8 --down 6 --legacy" in swapped.stderr and len(swapped.stderr.splitlines()) == 1
    contradicted = run("--across", "8", "--down", "6", "--new")
    assert contradicted.returncode == 5 and "--legacy" in contradicted.stderr
    good = run("--across", "8", "--down", "6")
    assert good.returncode == 0 and "board  8 x 6 squares, legacy pattern, as the pictures show" in good.stdout
