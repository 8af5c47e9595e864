"""A camera that is not mounted as drawn: found from emulated views by the command line, and measured right with."""

import csv

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from calibration.board import Board, Corners, board_image
from calibration.mount import calibrate_mount, read_poses
from gonio.cli import app
from gonio.config import load_config
from gonio.config.rig import RigConfig
from gonio.rig.build import view_of
from gonio.rig.calibration import CameraCalibration, load_calibration
from gonio.rig.errors import CalibrationMissing
from gonio.rig.signal.view import rotation_of
from sim.lit_patch import astray
from tests.conftest import ROOT

cv2 = pytest.importorskip("cv2")
AIM, SHIFT = (0.5, -0.4, 3.0), (0.8, 0.5, 2.0)
BOARD = Board(square=0.008, marker=0.006)


def rig(**camera):
    """camera.yaml with a larger picture and one channel, its camera bumped into."""
    raw = yaml.safe_load((ROOT / "configs/rigs/camera.yaml").read_text())
    raw["camera"] |= {"width": 360, "height": 270, "focal_px": 900, "channels": [0], "exposure_s": [0.0064, 0.0512]}
    raw["camera"] |= {"lit_mm": 5.0, "discard_frames": 2}
    raw["camera"]["sensor"] |= {"aim_deg": list(AIM), "shift_mm": list(SHIFT), "delay_frames": 1}
    raw["camera"] |= camera
    return raw


def write(path, raw):
    path.write_text(yaml.safe_dump(raw))
    return path, load_config(path, RigConfig)


def looks(n, seed=0):
    most = np.radians([0, 90, 40, 90])
    return np.random.default_rng(seed).uniform(-most, most, (n, 4))


LYING, PLACE = rotation_of(np.array([0.05, -0.03, 0.4])), np.array([-0.030, -0.012, 0.001])


def picture(view, pose, rng):
    """The board, lying askew in the sample's place, as the emulated camera sees it."""
    scale, margin = 60, 30
    board = cv2.copyMakeBorder(board_image(BOARD, scale), *[margin] * 4, cv2.BORDER_CONSTANT, value=255)
    to_plane = np.array([[BOARD.square / scale, 0, 0], [0, BOARD.square / scale, 0], [0, 0, 1.0]])
    to_plane[:2, 2] = -margin * BOARD.square / scale
    turn = view.rotation @ view.arm(pose)
    # the board's face is up: its y axis, down in the picture, runs backwards
    axes = turn @ LYING @ np.diag([1.0, -1.0, -1.0])
    centre = turn @ (LYING @ np.diag([1.0, -1.0, -1.0]) @ [0, 0, 0] + PLACE + [0, 0.03, 0]) + view.translation
    homography = view.matrix @ np.column_stack([axes[:, 0], axes[:, 1], centre]) @ to_plane
    seen = cv2.warpPerspective(board, homography, view.size, flags=cv2.INTER_AREA, borderValue=128)
    seen = cv2.GaussianBlur(seen, (0, 0), 0.7) + rng.normal(0, 2, seen.shape)
    return np.clip(seen, 0, 255).astype(np.uint8)


def run(*arguments):
    done = CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


def measured(path):
    return float(run("measure", 45, 0, "--rig", path, "--json").split('"f": [')[1].split("]")[0].split(",")[0])


def test_from_views_to_a_right_reading(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path, config = write(tmp_path / "bumped.yaml", rig())
    true = astray(view_of(config), AIM, SHIFT)
    rng = np.random.default_rng(0)
    with (tmp_path / "poses.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["view", *(f"{n}_deg" for n in config.axis_names)])
        for k, pose in enumerate(looks(16)):
            cv2.imwrite(str(tmp_path / f"view{k:02}.png"), picture(true, pose, rng))
            rows.writerow([f"view{k:02}.png", *np.degrees(pose)])
    views = sorted(tmp_path.glob("view*.png"))
    size = ["--square-mm", 8, "--marker-mm", 6]
    said = run("calibrate", "camera", *views, "--poses", "poses.csv", "--rig", path, *size)
    file = next((tmp_path / "calibrations").glob("camera-*.yaml"))
    assert "mount 0." in said and f"calibrations/{file.name}: name it in the rig's YAML as calibration.camera" in said
    found = load_calibration(file, CameraCalibration)
    np.testing.assert_allclose(np.array(found.matrix)[[0, 1], [0, 1]], 900, rtol=0.02)
    # where things are seen is what counts: focal length and distance make up for each other
    got = view_of(config, None, found)
    spots = np.array([[0.002, 0, 0], [0, 0.002, 0], [-0.002, -0.002, 0]])
    for pose in looks(20, seed=9):
        np.testing.assert_allclose(got.project(spots, pose), true.project(spots, pose), atol=1.0)

    raw = rig()
    raw["calibration"] = {"camera": str(file)}
    known, _ = write(tmp_path / "known.yaml", raw)
    blind = abs(measured(path) * np.pi - 1)
    assert blind > 0.02 and abs(measured(known) * np.pi - 1) < 0.01


def test_the_rig_takes_the_views_by_itself(tmp_path, monkeypatch):
    """One command: where the camera looks is found, and a reading comes out right; no picture is written over."""
    monkeypatch.chdir(tmp_path)
    path, config = write(tmp_path / "bumped.yaml", rig())
    true = astray(view_of(config), AIM, SHIFT)
    size = ["--square-mm", 8, "--marker-mm", 6]
    said = run("calibrate", "camera", "--drive", 14, "--rig", path, *size)
    assert "mount 0." in said and len(list((tmp_path / "views").glob("view*.png"))) == 14
    found = load_calibration(next((tmp_path / "calibrations").glob("camera-*.yaml")), CameraCalibration)
    got = view_of(config, None, found)
    spots = np.array([[0.002, 0, 0], [0, 0.002, 0], [-0.002, -0.002, 0]])
    for pose in looks(20, seed=9):
        np.testing.assert_allclose(got.project(spots, pose), true.project(spots, pose), atol=1.0)
    call = ["calibrate", "camera", "--drive", "14", "--rig", str(path)]
    done = CliRunner().invoke(app, [*call, *map(str, size)])
    assert "has views already; name another folder" in str(done.exception)
    done = CliRunner().invoke(app, [*call, "--square-mm", "80", "--marker-mm", "60", "--views", "large"])
    assert "print a smaller one" in str(done.exception) and not (tmp_path / "large").exists()
    done = CliRunner().invoke(app, ["calibrate", "camera", "--drive", "14", "--rig", "sim"])
    assert "takes no pictures" in str(done.exception)


def test_a_view_is_taken_with_its_pose(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path, config = write(tmp_path / "eye.yaml", rig(lit_mm=20.0, width=120, height=90, focal_px=300))
    for k in range(2):
        said = run("calibrate", "camera", "--take", f"v{k}.png", "--rig", path)
    assert "light -45.00  turntable 0.00  detector 45.00" in said and "added to poses.csv" in said
    poses = read_poses(tmp_path / "poses.csv", config)
    assert list(poses) == ["v0.png", "v1.png"]
    np.testing.assert_allclose(np.degrees(poses["v1.png"]), [-45, 0, 45, 0], atol=0.05)
    seen = cv2.imread("v1.png", cv2.IMREAD_GRAYSCALE)
    lit = np.hypot(*np.moveaxis(astray(view_of(config), AIM, SHIFT).on_sample(poses["v1.png"]), -1, 0)) < 0.0095
    assert seen.shape == (90, 120) and seen[lit].mean() > 150
    done = CliRunner().invoke(app, ["calibrate", "camera", "--take", "no/v.png", "--rig", str(path)])
    assert isinstance(done.exception, CalibrationMissing) and "cannot be written" in str(done.exception)


def test_dark_and_flat_by_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    raw = rig()
    raw["camera"] |= {"width": 64, "height": 48, "focal_px": 1600, "lit_mm": 12.0}
    raw["camera"]["sensor"] |= {"aim_deg": [0, 0, 0], "shift_mm": [0, 0, 0]}
    path, _ = write(tmp_path / "eye.yaml", raw)
    said = run("calibrate", "camera", "--dark", "--rig", path)
    dark = next((tmp_path / "calibrations").glob("frames-*.npz"))
    assert "2 dark frames" in said and dark.name in said
    raw["calibration"] = {"frames": str(dark)}
    named, _ = write(tmp_path / "named.yaml", raw)
    assert "flat from 0.8" in run("calibrate", "camera", "--flat", "--rig", named, "--out", "flat")
    raw["calibration"] = {"frames": str(next((tmp_path / "flat").glob("*.npz"))), "max_age_days": 30}
    flat, _ = write(tmp_path / "flat.yaml", raw)
    assert abs(measured(flat) * np.pi - 1) < 0.01
    said = run("calibrate", "radiometry", "--f", 0.3, "--rig", flat)
    gain = float(said.split("gain ")[1].split(" ")[0])
    np.testing.assert_allclose(gain, np.pi * 1.1e4 / 2, rtol=0.01)
    raw["calibration"]["radiometry"] = str(next((tmp_path / "calibrations").glob("radiometry-*.yaml")))
    whole, _ = write(tmp_path / "whole.yaml", raw)
    assert abs(measured(whole) * np.pi - 1) < 0.01
    raw["camera"]["exposure_s"] = [0.001, 0.01]
    other, _ = write(tmp_path / "other.yaml", raw)
    done = CliRunner().invoke(app, ["measure", "45", "0", "--rig", str(other)])
    assert done.exit_code != 0
    with pytest.raises(CalibrationMissing, match="made for other exposures"):
        raise done.exception


def test_views_that_do_not_tell_the_mount_are_refused():
    config = RigConfig.model_validate(rig())
    view = view_of(config)
    camera = CameraCalibration(
        id="x", date="2026-01-01T00:00:00Z", rig="camera", matrix=view.matrix.tolist(), distortion=(0.0,) * 5,
        size=(360, 270), rms_px=0.1, views=8,
    )  # fmt: skip
    board = np.stack([*np.meshgrid(np.linspace(-0.02, 0.02, 5), np.linspace(-0.015, 0.015, 4)), np.zeros((4, 5))], -1)
    board = board.reshape(-1, 3).astype(np.float32)
    rng = np.random.default_rng(0)
    seen = lambda pose: Corners(board, (view.project(board, pose) + rng.normal(0, 0.1, (20, 2))).astype(np.float32))
    good = looks(8)
    found = calibrate_mount(camera, [seen(p) for p in good], list(good), config)
    np.testing.assert_allclose(found.mount_m, [0, 0, 0.2], atol=3e-4)
    for poses, message in (
        (good[:3], "3 views with a pose, 6 are the least"),
        (good[:1].repeat(8, 0), "the views tell its place to"),
        (good * [1, 0, 1, 0], "the views tell its place to"),
    ):
        with pytest.raises(CalibrationMissing, match=message):
            calibrate_mount(camera, [seen(p) for p in poses], list(poses), config)
    with pytest.raises(CalibrationMissing, match="no mount explains the views"):
        calibrate_mount(camera, [seen(p) for p in good], list(np.roll(good, 1, 0)), config)
