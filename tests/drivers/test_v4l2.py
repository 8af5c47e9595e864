"""The thin layer under the seam, on a VideoCapture made of Python: what it sets, what it believes, when it gives up."""

import threading

import numpy as np
import pytest

from drivers.camera import Camera
from drivers.v4l2 import V4l2Source
from gonio.config.detectors import CameraConfig
from gonio.config.devices import CameraDeviceConfig
from gonio.rig.errors import DeviceFault

cv2 = pytest.importorskip("cv2")
CONFIG = CameraConfig(width=64, height=48, exposure_s=(0.001, 0.01), discard_frames=2)


class Capture:
    """As OpenCV's: properties as floats, -1 for what there is not, frames every few milliseconds."""

    def __init__(self, device, backend):
        assert backend == cv2.CAP_V4L2
        self.opened = "there" in device
        self.kept = {cv2.CAP_PROP_AUTO_EXPOSURE: 3.0, cv2.CAP_PROP_EXPOSURE: 156.0, cv2.CAP_PROP_GAIN: 64.0}
        self.fixed = {}
        self.going, self.released, self.count = threading.Event(), False, 0
        self.going.set()
        self.came, self.blocked = threading.Event(), threading.Event()

    def isOpened(self):
        return self.opened

    def set(self, key, value):
        self.kept[key] = float(value)
        return True

    def get(self, key):
        return self.fixed.get(key, self.kept.get(key, -1.0))

    def read(self):
        if not self.going.is_set():
            self.blocked.set()
        if not self.going.wait(0.2):
            return False, None
        self.count += 1
        self.came.set()
        level = 10 + self.kept[cv2.CAP_PROP_EXPOSURE]
        if self.kept.get(cv2.CAP_PROP_CONVERT_RGB) == 0:
            return True, np.full((48, 64), level, np.uint16)
        return True, np.full((48, 64, 3), level, np.uint8)

    def release(self):
        self.released = True


@pytest.fixture
def opened(monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    made = []

    def make(format="YUYV"):
        made.append(V4l2Source(CameraDeviceConfig(device="/dev/there", format=format), CONFIG))
        return made[-1]

    yield make
    for source in made:
        source.capture.going.set()
        source.close()
        assert source.capture.released


def test_format_and_size_are_asked_for_and_settings_read_back(opened):
    source = opened()
    kept = source.capture.kept
    assert kept[cv2.CAP_PROP_FOURCC] == cv2.VideoWriter.fourcc(*"YUYV") and kept[cv2.CAP_PROP_FRAME_WIDTH] == 64
    camera = Camera(source, CONFIG)
    camera.configure()
    assert kept[cv2.CAP_PROP_AUTO_EXPOSURE] == 1 and kept[cv2.CAP_PROP_GAIN] == 0
    assert source.get("autofocus") is None and cv2.CAP_PROP_AUTOFOCUS not in kept  # it has none
    assert camera.frame(0.01).shape == (48, 64, 3) and kept[cv2.CAP_PROP_EXPOSURE] == 100
    source.capture.fixed[cv2.CAP_PROP_EXPOSURE] = 156.0
    with pytest.raises(DeviceFault, match="exposure set to 10 reads 156"):
        camera.frame(0.001)


def test_sixteen_bits_come_as_they_are(opened):
    source = opened("Y16 ")
    frame = source.frame(5.0)
    assert frame.dtype == np.uint16 and frame.shape == (48, 64) and source.full_scale == 4095


def test_each_frame_is_a_new_one(opened):
    source = opened()
    source.frame(5.0)
    before = source.capture.count
    source.capture.came.clear()
    assert source.capture.came.wait(60)  # some come meanwhile; none of them is kept for later
    source.frame(5.0)
    assert source.capture.count > before + 1


def test_a_camera_that_stops_is_not_waited_for_longer_than_the_deadline(opened):
    source = opened()
    source.frame(5.0)
    source.capture.going.clear()
    assert source.capture.blocked.wait(60)
    assert source.frame(0.05) is None
    camera = Camera(source, CONFIG.model_copy(update={"deadline_s": 0.05, "frame_s": 0.001}))
    with pytest.raises(DeviceFault, match="camera: delivers no frames"):
        camera.frame(0.001)


def test_what_is_not_there_or_not_as_asked_is_named(monkeypatch):
    monkeypatch.setattr(cv2, "VideoCapture", Capture)
    with pytest.raises(DeviceFault, match="/dev/none cannot be opened"):
        V4l2Source(CameraDeviceConfig(device="/dev/none"), CONFIG)
    plain = Capture.get
    for key, message in (
        (cv2.CAP_PROP_FRAME_WIDTH, "width set to 64 reads 640"),
        (cv2.CAP_PROP_FOURCC, "format set to YUYV reads 640"),
    ):
        monkeypatch.setattr(Capture, "get", lambda self, k, key=key: 640.0 if k == key else plain(self, k))
        with pytest.raises(DeviceFault, match=message):
            V4l2Source(CameraDeviceConfig(device="/dev/there"), CONFIG)
