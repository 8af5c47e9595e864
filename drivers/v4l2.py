"""OpenCV's VideoCapture on V4L2 as a frame source. A reader of its own keeps OpenCV's queue empty."""

import threading

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.v4l2_query import query
from gonio.config.detectors import CameraConfig
from gonio.config.devices import CameraDeviceConfig
from gonio.rig.errors import DeviceFault

PROPERTIES = {
    "auto_exposure": cv2.CAP_PROP_AUTO_EXPOSURE,
    "exposure": cv2.CAP_PROP_EXPOSURE,
    "gain": cv2.CAP_PROP_GAIN,
    "auto_white_balance": cv2.CAP_PROP_AUTO_WB,
    "white_balance": cv2.CAP_PROP_WB_TEMPERATURE,
    "autofocus": cv2.CAP_PROP_AUTOFOCUS,
    "sharpness": cv2.CAP_PROP_SHARPNESS,
    "gamma": cv2.CAP_PROP_GAMMA,
}


class V4l2Source:
    """Implements `drivers.camera.FrameSource`. YUYV comes as blue, green, red of 8 bits; GREY and Y16 as they are."""

    def __init__(self, device: CameraDeviceConfig, config: CameraConfig):
        self.device, self.config = device, config
        self.full_scale = 255.0 if device.format != "Y16 " else 2.0**config.sensor.bits - 1
        self.capture = cv2.VideoCapture(device.device, cv2.CAP_V4L2)
        if not self.capture.isOpened():
            raise DeviceFault("camera", f"{device.device} cannot be opened", "check its cable, and who else uses it")
        fourcc = cv2.VideoWriter.fourcc(*device.format)
        wanted = {
            "format": (cv2.CAP_PROP_FOURCC, fourcc),
            "width": (cv2.CAP_PROP_FRAME_WIDTH, config.width),
            "height": (cv2.CAP_PROP_FRAME_HEIGHT, config.height),
        }
        for name, (key, value) in wanted.items():
            self.capture.set(key, value)
            if (found := self.capture.get(key)) != value:
                self.capture.release()
                text = device.format if name == "format" else value
                raise DeviceFault("camera", f"{name} set to {text} reads {found:g}", "see `gonio doctor`")
        if device.format != "YUYV":
            self.capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        self._new = threading.Condition()
        self._frame: NDArray | None = None
        self._closed = False
        self._reader = threading.Thread(target=self._read, daemon=True, name="camera")
        self._reader.start()

    def describe(self) -> tuple[str, list[str]]:
        return query(self.device.device)

    def set(self, name: str, value: float) -> None:
        self.capture.set(PROPERTIES[name], value)

    def get(self, name: str) -> float | None:
        value = self.capture.get(PROPERTIES[name])
        return None if value < 0 else float(value)  # OpenCV's way to say that there is none

    def frame(self, deadline_s: float) -> NDArray | None:
        with self._new:
            self._frame = None
            self._new.wait_for(lambda: self._frame is not None, max(deadline_s, 0))
            return self._frame

    def _read(self) -> None:
        while not self._closed:
            ok, frame = self.capture.read()
            with self._new:
                self._frame = self._plain(np.asarray(frame)) if ok else None
                self._new.notify_all()
            if not ok and not self._closed:
                threading.Event().wait(0.05)

    def _plain(self, frame: NDArray) -> NDArray:
        if self.device.format == "YUYV":
            return frame
        kind = np.uint8 if self.device.format == "GREY" else np.uint16
        return np.frombuffer(frame.tobytes(), kind).reshape(self.config.height, self.config.width)

    def close(self) -> None:
        self._closed = True
        self._reader.join(timeout=11)  # OpenCV waits 10 s for a frame that does not come
        self.capture.release()
