"""All of the camera driver above the frame source, on a simulated sensor."""

import numpy as np
import pytest

from drivers import camera as module
from drivers.camera import Camera, CameraDetector, region_of
from drivers.hdr import merge
from gonio.rig.errors import DeviceFault
from sim.wire.camera import SimFrames

EXPOSURES = (0.001, 0.008, 0.064)


class Scene:
    def __init__(self, *radiance):
        self.radiance = np.array(radiance, float)

    def __call__(self):
        return self.radiance


def made(scene, **kwargs):
    source = SimFrames(scene, **kwargs)
    # counts: read noise 3 electrons at 2 electrons a count, and k = counts per electron
    camera = Camera(source, read_noise=np.hypot(1.5, 0.29), k=0.5)
    camera.configure()
    return camera, source


def test_nothing_automatic_is_left_on():
    _, source = made(Scene(1e4))
    assert {k: source.get(k) for k in ("auto_exposure", "auto_white_balance", "autofocus", "gain")} == {
        "auto_exposure": 1, "auto_white_balance": 0, "autofocus": 0, "gain": 0,
    }  # fmt: skip


@pytest.mark.parametrize("name", ["auto_exposure", "gain"])
def test_a_setting_that_does_not_take_is_told(name):
    source = SimFrames(Scene(1e4))
    source.stubborn.add(name)
    with pytest.raises(DeviceFault, match=f"camera: {name} set to"):
        Camera(source).configure()


def test_frames_settle_after_a_change_of_exposure():
    camera, source = made(Scene(1e5), hot=0)
    for t in (0.001, 0.064, 0.008, 0.001):
        mean = camera.frame(t).mean() - 16
        np.testing.assert_allclose(mean, (1e5 * source.gain_map.mean() + 20) * t / 2, rtol=0.03)


def test_without_waiting_the_frame_is_an_old_one(monkeypatch):
    camera, _ = made(Scene(1e5), hot=0)
    short = camera.frame(0.001).mean()
    monkeypatch.setattr(module, "LEAST", 0)
    monkeypatch.setattr(module, "SETTLED", 1e9)
    assert abs(camera.frame(0.064).mean() - short) < 0.2 * short


def test_a_camera_that_stops_delivering_is_named():
    camera, source = made(Scene(1e4))
    source.dead = True
    with pytest.raises(DeviceFault, match="camera: delivers no frames; check its cable"):
        camera.frame(0.008)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_hdr_is_linear_over_four_decades(bits):
    """Ratios of radiance come back as they are, from the dimmest that shows to the brightest that does not clip."""
    scene = Scene(0.0)
    electrons = {8: 100.0, 12: 10.0, 16: 2.0}[bits]
    source = SimFrames(scene, bits=bits, electrons_per_count=electrons, vignetting=0.0)
    camera = Camera(source, read_noise=np.hypot(3 / electrons, 0.29), k=1 / electrons)
    camera.configure()
    camera.learn_dark(EXPOSURES)
    top = 0.9 * (source.full_scale - 16) * electrons / EXPOSURES[0]
    for share in (1.0, 0.1, 1e-2, 1e-3) + ((1e-4,) if bits > 8 else ()):
        scene.radiance = np.array([top * share])
        p = camera.picture(EXPOSURES)
        good = np.isfinite(p.value)
        got = p.value[good].mean() * electrons
        assert not p.saturated.any()
        np.testing.assert_allclose(got, top * share, rtol=0.02, atol=4 * electrons)


def test_sigma_is_that_of_the_readings():
    camera, _ = made(Scene(5e4), vignetting=0.0)
    scene, camera.source.scene = camera.source.scene, Scene(0.0)
    camera.learn_dark(EXPOSURES, frames=32)
    camera.source.scene = scene
    p = camera.picture(EXPOSURES)
    good = np.isfinite(p.value)
    z = (p.value[good] - 5e4 / 2) / p.sigma[good]
    assert abs(z.mean()) < 0.2 and 0.9 < z.std() < 1.1


def test_weights_by_inverse_variance_beat_the_longest_alone():
    camera, _ = made(Scene(5e4), vignetting=0.0)
    both, one = camera.picture((0.032, 0.064)), camera.picture((0.064,))
    assert np.nanmean(both.sigma) < 0.9 * np.nanmean(one.sigma)


def test_saturated_everywhere_is_said():
    camera, _ = made(Scene(1e9))
    p = camera.picture(EXPOSURES)
    assert p.saturated.all()
    reading = CameraDetector(camera, EXPOSURES, 0.02, lambda: (slice(10, 20), slice(10, 20))).read()
    assert reading.saturated and reading.raw["exposure_s"] == 0.02


def test_a_saturated_exposure_takes_no_part():
    frames = [np.full((2, 2, 1), 100.0), np.full((2, 2, 1), 4095.0)]
    p = merge(frames, [0.001, 0.1], [np.zeros((2, 2, 1))] * 2, 4095.0, 2.0, 0.5)
    np.testing.assert_allclose(p.value, 1e5)
    assert not p.saturated.any()


def test_flat_and_bad_pixels():
    scene = Scene(0.0, 0.0, 0.0)
    camera, source = made(scene, vignetting=0.4, hot=7)
    camera.learn_dark(EXPOSURES, frames=8)
    found = set(np.flatnonzero(camera.bad.ravel()))
    assert set(source.hot) <= found and len(found) < 20
    scene.radiance = np.array([4e4, 4e4, 4e4])
    camera.learn_flat(EXPOSURES)
    scene.radiance = np.array([4e4, 2e4, 1e4])
    p = camera.picture(EXPOSURES)
    assert np.isnan(p.value[camera.bad]).all()
    corner, centre = np.nanmean(p.value[:8, :8], (0, 1)), np.nanmean(p.value[20:28, 28:36], (0, 1))
    np.testing.assert_allclose(corner, centre, rtol=0.02)
    r = CameraDetector(camera, EXPOSURES, 0.02, lambda: (slice(4, 44), slice(4, 60))).read()
    np.testing.assert_allclose(r.value / r.value[0], [1, 0.5, 0.25], rtol=0.02)
    assert (r.sigma < 0.01 * r.value).all()


def test_the_region_follows_the_pose():
    matrix = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])
    calibration = {"matrix": matrix, "distortion": np.zeros(5)}
    corners = np.array([[-10.0, -10, 0], [10, -10, 0], [10, 10, 0], [-10, 10, 0]])
    pose = np.zeros(3), np.array([0.0, 0.0, 250.0])
    rows, columns = region_of(corners, *pose, calibration, (640, 480))
    assert (rows.start, rows.stop, columns.start, columns.stop) == (220, 261, 300, 341)
    tilted, _ = region_of(corners, np.array([np.radians(60.0), 0, 0]), pose[1], calibration, (640, 480))
    assert tilted.stop - tilted.start < 25
    with pytest.raises(DeviceFault, match="outside its picture"):
        region_of(corners, np.zeros(3), np.array([200.0, 0, 250]), calibration, (640, 480))
