"""All of the camera driver above the frame source, on a simulated sensor."""

import struct

import numpy as np
import pytest

from drivers import camera as module
from drivers.camera import Camera
from drivers.camera_detector import CameraDetector
from drivers.hdr import in_the_middle, merge
from drivers.v4l2_query import ENUM_FMT, QUERYCAP, query
from gonio.config.detectors import CameraConfig, SensorConfig
from gonio.rig.errors import DeviceFault
from sim.camera import SimFrames

LADDER = (0.001, 0.008, 0.064)


class Scene:
    def __init__(self, *radiance):
        self.radiance = np.array(radiance, float)

    def __call__(self):
        return self.radiance


def made(scene, ladder=LADDER, **sensor):
    config = CameraConfig(
        exposure_s=ladder,
        width=64,
        height=48,
        channels=tuple(range(len(scene.radiance))),
        sensor=SensorConfig(**sensor),
    )
    source = SimFrames(scene, config.sensor, (48, 64, len(scene.radiance)))
    camera = Camera(source, config)
    camera.configure()
    return camera, source


def dark_learnt(scene, **kwargs):
    camera, source = made(scene, **kwargs)
    lit, scene.radiance = scene.radiance, 0 * scene.radiance
    camera.learn_dark()
    scene.radiance = lit
    return camera, source


def middle(size=20):
    return slice(24 - size // 2, 24 + size // 2), slice(32 - size // 2, 32 + size // 2), np.ones((size, size), bool)


def test_nothing_automatic_is_left_on():
    camera, source = made(Scene(1e4))
    wanted = {"auto_exposure": 1, "auto_white_balance": 0, "autofocus": 0, "gain": 0}
    assert {k: source.get(k) for k in wanted} == wanted and source.get("white_balance") == 4600
    camera.config = camera.config.model_copy(update={"white_balance_k": 5000, "gain": 3.0})
    camera.configure()
    assert source.get("white_balance") == 5000 and source.get("gain") == 3
    del source.settings["white_balance"]
    with pytest.raises(DeviceFault, match=r"no white balance to set; set camera\.white_balance_k to null"):
        camera.configure()


@pytest.mark.parametrize("name", ["auto_exposure", "gain", "exposure"])
def test_a_setting_that_does_not_take_is_told(name):
    camera, source = made(Scene(1e4))
    source.stubborn.add(name)
    source.settings[name] = 77.0
    with pytest.raises(DeviceFault, match=f"camera: {name} set to .* reads 77"):
        camera.configure()
        camera.frame(0.008)


def test_frames_settle_after_a_change_of_exposure():
    camera, source = made(Scene(1e5), hot_pixels=0)
    for t in (0.001, 0.064, 0.008, 0.001):
        mean = camera.frame(t).mean() - 16
        np.testing.assert_allclose(mean, (1e5 * source.gain_map.mean() + 20) * t / 2, rtol=0.03)


def test_without_waiting_the_frame_is_an_old_one(monkeypatch):
    camera, _ = made(Scene(1e5), hot_pixels=0)
    short = camera.frame(0.001).mean()
    camera.config = camera.config.model_copy(update={"discard_frames": 0})
    monkeypatch.setattr(module, "SETTLED", 1e9)
    assert abs(camera.frame(0.064).mean() - short) < 0.2 * short


def test_a_move_is_waited_for_too():
    """What is seen changes, no setting does: the buffered frames of before are not taken for it."""
    scene = Scene(1e5)
    camera, _ = made(scene, hot_pixels=0)
    before = camera.frame(0.008).mean()
    scene.radiance = np.array([3e4])
    after = camera.frame(0.008).mean()
    np.testing.assert_allclose((after - 16) / (before - 16), 0.3, rtol=0.02)
    assert (camera.more(0.008).mean() - 16) / (after - 16) == pytest.approx(1, rel=0.01)


def test_a_light_that_flickers_is_told():
    scene = Scene(1e5)
    camera, _ = made(scene)
    levels = iter(np.tile([1e5, 2e4], 50))
    camera.source.scene = lambda: np.array([next(levels)])
    with pytest.raises(DeviceFault, match="unsettled after 28 frames; is the light flickering"):
        camera.frame(0.008)


def test_a_camera_that_stops_delivering_is_named():
    camera, source = made(Scene(1e4))
    source.dies_after = 3
    with pytest.raises(DeviceFault, match="camera: delivers no frames; check its cable"):
        camera.frame(0.008)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_hdr_is_linear_over_four_decades(bits):
    """Ratios of radiance come back as they are, from the dimmest that shows to the brightest that does not clip."""
    scene = Scene(0.0)
    electrons = {8: 100.0, 12: 10.0, 16: 2.0}[bits]
    camera, source = dark_learnt(scene, bits=bits, electrons_per_count=electrons, vignetting=0.0)
    top = 0.9 * (source.full_scale - 16) * electrons / LADDER[0]
    for share in (1.0, 0.1, 1e-2, 1e-3) + ((1e-4,) if bits > 8 else ()):
        scene.radiance = np.array([top * share])
        p = camera.picture(range(3))
        good = np.isfinite(p.value)
        got = p.value[good].mean() * electrons
        assert not p.saturated.any()
        np.testing.assert_allclose(got, top * share, rtol=0.005, atol=0.5 * electrons)


def test_sigma_is_that_of_the_readings():
    camera, _ = dark_learnt(Scene(5e4), vignetting=0.0)
    p = camera.picture(range(3))
    good = np.isfinite(p.value)
    z = (p.value[good] - 5e4 / 2) / p.sigma[good]
    assert abs(z.mean()) < 0.05 and 0.95 < z.std() < 1.05
    detector = CameraDetector(camera, 0.02, middle)
    r = []
    for k in range(60):
        camera.source.announce(k)
        r.append(detector.read())
    value, sigma = np.array([x.value[0] for x in r]), np.array([x.sigma[0] for x in r])
    np.testing.assert_allclose(value.mean(), 5e4 / 2 * 0.02, rtol=2e-3)
    assert 0.75 < value.std() / sigma.mean() < 1.25


def test_weights_are_not_made_of_the_noise_they_weigh():
    """Two like exposures of some electrons a pixel: weights by the counts themselves would read some per cent low."""
    rng = np.random.default_rng(0)
    frames = [rng.poisson(8.0, (400, 400, 1)) + rng.normal(0, 1, (400, 400, 1)) for _ in range(2)]
    zero = np.zeros((400, 400, 1))
    p = merge(frames, [1.0, 1.0001], [zero, zero], 4095.0, 1.0, 1.0)
    np.testing.assert_allclose(p.value.mean(), 8.0, rtol=0.003)
    w = [1 / (1 + np.maximum(f, 0)) for f in frames]
    naive = (w[0] * frames[0] + w[1] * frames[1]) / (w[0] + w[1])
    assert naive.mean() < 7.8


def test_weights_by_inverse_variance_beat_the_longest_alone():
    camera, _ = dark_learnt(Scene(5e4), ladder=(0.032, 0.064), vignetting=0.0)
    both, one = camera.picture(range(2)), camera.picture(range(1, 2))
    assert np.nanmean(both.sigma) < 0.9 * np.nanmean(one.sigma)


def test_saturated_everywhere_is_said():
    camera, _ = dark_learnt(Scene(1e9, 1e4))
    p = camera.picture(range(3))
    assert p.saturated.all()  # though the second plane is well
    reading = CameraDetector(camera, 0.02, middle).read()
    assert reading.saturated and reading.raw["exposure_s"] == 0.02 and np.isfinite(reading.sigma).all()
    np.testing.assert_allclose(reading.value[1], 1e4 / 2 * 0.02, rtol=0.01)


def test_a_saturated_exposure_takes_no_part():
    frames = [np.full((2, 2, 1), 100.0), np.full((2, 2, 1), 4095.0)]
    p = merge(frames, [0.001, 0.1], [np.zeros((2, 2, 1))] * 2, 4095.0, 2.0, 0.5)
    np.testing.assert_allclose(p.value, 1e5)
    assert not p.saturated.any()


def test_flat_and_bad_pixels():
    scene = Scene(0.0, 0.0, 0.0)
    camera, source = dark_learnt(scene, vignetting=0.4, hot_pixels=7)
    found = set(np.flatnonzero(camera.frames.bad.ravel()))
    assert set(source.hot) <= found and len(found) < 20
    with source.even(0.008):
        camera.learn_flat()
    scene.radiance = np.array([4e4, 2e4, 1e4])
    p = camera.picture(range(3))
    assert np.isnan(p.value[camera.frames.bad]).all()
    corner, centre = np.nanmean(p.value[:8, :8], (0, 1)), np.nanmean(p.value[20:28, 28:36], (0, 1))
    np.testing.assert_allclose(corner, centre, rtol=0.02)
    region = slice(4, 44), slice(4, 60), np.ones((40, 56), bool)
    r = CameraDetector(camera, 0.02, lambda: region).read()
    np.testing.assert_allclose(r.value / 2e4 / 0.02, [1, 0.5, 0.25], rtol=0.005)
    assert (r.sigma < 0.01 * r.value).all()


def test_the_middle_of_a_flat_picture():
    camera, source = dark_learnt(Scene(0.0, 0.0), vignetting=0.4)
    noisy = source.gain_map * [1.0, 5.0] * np.random.default_rng(0).normal(1, 0.02, (48, 64, 2))
    np.testing.assert_allclose(in_the_middle(noisy, ~camera.frames.bad), [1, 5], rtol=3e-3)
    big = np.kron(noisy, np.ones((20, 20, 1)))
    np.testing.assert_allclose(in_the_middle(big, np.ones(big.shape[:2], bool)), [1, 5], rtol=5e-3)


def test_raw_planes_are_taken_in_the_order_named():
    scene = Scene(1e4, 2e4, 4e4)  # blue, green, red
    camera, _ = dark_learnt(scene, vignetting=0.0)
    camera.config = camera.config.model_copy(update={"channels": (2, 0)})
    np.testing.assert_allclose(CameraDetector(camera, 1.0, middle).read().value, [2e4, 5e3], rtol=0.01)


@pytest.mark.parametrize("radiance", [3e1, 1e3, 3e4, 6.1e4, 3e6])
def test_a_reading_is_the_same_wherever_its_search_began(radiance):
    camera, source = dark_learnt(Scene(radiance, radiance / 30), vignetting=0.0)
    detector, seen = CameraDetector(camera, 0.02, middle), []
    for guess in range(3):
        for expected in (None, np.array([radiance, radiance / 30]) / 2 * 0.02):
            detector.restore({"guess": guess})
            detector.expect(expected)
            source.announce(5)
            source.delivered = 0
            r = detector.read()
            seen.append((r.value.tolist(), r.sigma.tolist(), r.saturated, r.raw))
    assert all(s == seen[0] for s in seen)
    wrong = np.array(seen[0][0]) - np.array([radiance, radiance / 30]) * 0.01
    assert (np.abs(wrong) < 5 * np.array(seen[0][1])).all()


def test_a_right_prediction_saves_frames():
    camera, source = dark_learnt(Scene(2e3), vignetting=0.0)
    detector, spent = CameraDetector(camera, 0.02, middle), []
    for known in (None, np.array([2e3 / 2 * 0.02])):
        detector.restore({"guess": 0})
        detector.expect(known)
        source.delivered = 0
        detector.read()
        spent.append(source.delivered)
    assert spent[1] == 5 and spent[0] >= 2 * spent[1]


def test_edge_on_there_is_no_reading():
    camera, _ = dark_learnt(Scene(2e3))
    few = np.zeros((20, 20), bool)
    few[0, :3] = True
    r = CameraDetector(camera, 0.02, lambda: (*middle()[:2], few)).read()
    assert np.isnan(r.value).all() and not r.saturated and r.raw["pixels"] == 3


def test_what_the_kernel_says_of_a_camera(tmp_path):
    """The two calls, answered as linux/videodev2.h lays them out."""
    node = tmp_path / "video0"
    node.touch()
    formats = [b"YUYV", b"MJPG", b"GREY"]

    def kernel(fd, request, data):
        if request == QUERYCAP:
            struct.pack_into(
                "16s32s32sIII", data, 0, b"uvcvideo", b"Bench Cam", b"usb-0000:1", 1, 0x84A00001, 0x04200001
            )
        elif request == ENUM_FMT:
            index, kind = struct.unpack_from("II", data)
            if index >= len(formats):
                raise OSError(22, "Invalid argument")
            assert kind == 1
            struct.pack_into("I32s4s", data, 8, 0, b"something", formats[index])

    assert query(str(node), kernel) == ("Bench Cam at usb-0000:1", ["YUYV", "MJPG", "GREY"])
    assert (QUERYCAP >> 16 & 0x3FFF, ENUM_FMT >> 16 & 0x3FFF) == (104, 64)

    def metadata(fd, request, data):
        struct.pack_into("16s32s32sIII", data, 0, b"uvcvideo", b"Bench Cam", b"usb-0000:1", 1, 0x84A00001, 0x04A00000)

    with pytest.raises(OSError, match="other node"):
        query(str(node), metadata)
