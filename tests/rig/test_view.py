"""What the camera on the arm sees of the sample, against OpenCV's own projection and against the rig's directions."""

import numpy as np
import pytest

from gonio.config import load_config
from gonio.config.rig import RigConfig
from gonio.rig.build import kinematics_of, view_of
from gonio.rig.calibration import GeometryCalibration
from gonio.rig.errors import DeviceFault
from gonio.rig.signal.view import View, distort, rotation_of, undistort
from tests.conftest import ROOT

CAMERA = load_config(ROOT / "configs/rigs/camera.yaml", RigConfig)
MATRIX = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])
BENT = np.array([-0.2, 0.05, 0.003, -0.002, 0.01])


def still(rotation=(0, 0, 0), translation=(0, 0, 0.25), distortion=BENT):
    turn = rotation_of(np.array(rotation, float))
    return View(MATRIX, np.array(distortion), (640, 480), turn, np.array(translation, float), lambda pose: np.eye(3))


def test_projection_is_that_of_opencv():
    cv2 = pytest.importorskip("cv2")
    rng = np.random.default_rng(0)
    points = rng.uniform(-0.05, 0.05, (50, 3))
    for _ in range(5):
        vector, at = rng.normal(0, 0.5, 3), rng.normal([0, 0, 0.4], 0.03)
        expected, _ = cv2.projectPoints(points, vector, at, MATRIX, BENT)
        np.testing.assert_allclose(still(vector, at).project(points, np.zeros(4)), expected[:, 0], atol=1e-9)
        np.testing.assert_allclose(rotation_of(vector), cv2.Rodrigues(vector)[0], atol=1e-12)


def test_distortion_has_an_inverse():
    p = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 2))
    np.testing.assert_allclose(undistort(distort(p, BENT), BENT), p, atol=1e-9)


def test_pixels_look_back_at_the_points_they_show():
    view = still((2.6, 0.3, 0.1))  # from above: the sample's z points at the camera
    plane = view.on_sample(np.zeros(4))
    for y, x in ((0, 0), (240, 320), (479, 100)):
        point = np.append(plane[y, x], 0.0)
        np.testing.assert_allclose(view.project(point[None], np.zeros(4))[0], [x, y], atol=1e-6)


def test_the_disk_is_where_the_plane_says():
    view = still((2.4, 0.3, 0.1))
    rows, columns, inside = view.disk(0.02, np.zeros(4))
    plane = view.on_sample(np.zeros(4))
    by_plane = np.hypot(*np.moveaxis(plane, -1, 0)) <= 0.01
    mine = np.zeros_like(by_plane)
    mine[rows, columns] = inside
    assert mine.sum() > 500 and (mine ^ by_plane).sum() < 0.03 * mine.sum()
    with pytest.raises(DeviceFault, match="outside its picture"):
        still((3.1, 0, 0), (0.2, 0, 0.25)).disk(0.02, np.zeros(4))


@pytest.mark.parametrize("calibration", [None, "bent"])
def test_the_camera_looks_along_wo(calibration):
    """At every pose, what lies on the line to the detector is in one pixel: that of the sample's middle."""
    if calibration:
        tilts = {"detector": (-0.005, 1, 0.006), "azimuth": (0.007, -0.004, 1)}
        calibration = GeometryCalibration(
            id="x", date="2026-01-01T00:00:00Z", rig="camera", offsets_deg={"light": 1.0, "detector": -2.0}, axes=tilts
        )
    view, rig = view_of(CAMERA, calibration), kinematics_of(CAMERA, calibration)
    for pose in np.random.default_rng(1).uniform(-1.2, 1.2, (50, 4)):
        _, wo = rig.forward(pose)
        seen = view.project(np.outer([0.0, 0.01, 0.05], wo), pose)
        np.testing.assert_allclose(seen, [[31.5, 23.5]] * 3, atol=1e-6)


def test_the_disk_is_foreshortened_by_the_cosine():
    view = view_of(CAMERA)
    counts = {}
    for theta in (0, 60, 80):
        for table in (0.0, 0.7):
            counts[theta, table] = view.disk(0.004, np.array([0, table, np.radians(theta), 0.3]))[2].sum()
    full = np.pi * 16**2
    for (theta, _), n in counts.items():
        np.testing.assert_allclose(n, full * np.cos(np.radians(theta)), rtol=0.06)
