"""OpenCV's VideoCapture on V4L2 as a frame source. A reader of its own keeps OpenCV's queue empty."""

import threading

import cv2
import numpy as np
from numpy.typing import NDArray

from gonio.config.rig import CameraConfig
from gonio.rig.errors import DeviceFault

PROPERTIES = {
    "auto_exposure": cv2.CAP_PROP_AUTO_EXPOSURE,
    "exposure": cv2.CAP_PROP_EXPOSURE,
    "gain": cv2.CAP_PROP_GAIN,
    "auto_white_balance": cv2.CAP_PROP_AUTO_WB,
    "autofocus": cv2.CAP_PROP_AUTOFOCUS,
    "sharpness": cv2.CAP_PROP_SHARPNESS,
    "gamma": cv2.CAP_PROP_GAMMA,
}


class V4l2Source:
    """Implements `drivers.camera.FrameSource`. Uncompressed frames: MJPEG is lossy and gamma-coded."""

    full_scale = 255.0

    def __init__(self, config: CameraConfig):
        self.config = config
        self.capture = cv2.VideoCapture(config.device, cv2.CAP_V4L2)
        if not self.capture.isOpened():
            raise DeviceFault("camera", f"{config.device} cannot be opened", "check its cable, and who else uses it")
        self.capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"YUYV"))
        self.capture.set(cv2.CAP_PROP_FRAME_WIDTH, config.width)
        self.capture.set(cv2.CAP_PROP_FRAME_HEIGHT, config.height)
        found = self.capture.get(cv2.CAP_PROP_FRAME_WIDTH), self.capture.get(cv2.CAP_PROP_FRAME_HEIGHT)
        if found != (config.width, config.height):
            self.capture.release()
            raise DeviceFault(
                "camera",
                f"size set to {config.width} x {config.height} reads {found[0]:g} x {found[1]:g}",
                "set devices.camera.width and height to what it can do",
            )
        self._new = threading.Condition()
        self._frame: NDArray | None = None
        self._closed = False
        self._reader = threading.Thread(target=self._read, daemon=True, name="camera")
        self._reader.start()

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
                self._frame = np.asarray(frame) if ok else None
                self._new.notify_all()
            if not ok and not self._closed:
                threading.Event().wait(0.05)

    def close(self) -> None:
        self._closed = True
        self._reader.join(timeout=11)  # OpenCV waits 10 s for a frame that does not come
        self.capture.release()
