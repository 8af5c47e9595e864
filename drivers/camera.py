"""The camera: settings made and read back, frames thrown away until they have settled, linear pictures of a region.

Everything here is above `FrameSource`, the seam under which lies OpenCV's VideoCapture or a simulated sensor.
"""

import time
from collections.abc import Callable, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.hdr import Picture, bad_pixels, merge
from gonio.geometry import Array
from gonio.rig.devices import Reading
from gonio.rig.errors import DeviceFault

SETTLED = 0.02  # relative difference of two frames' means that counts as none
LEAST = 2  # frames thrown away after a change whatever they look like: they were under way
MOST = 24
DEADLINE_S = 5.0  # for one frame; OpenCV's own is 10 s

MANUAL = {"auto_exposure": 1, "auto_white_balance": 0, "autofocus": 0, "sharpness": 0, "gamma": 100}


class FrameSource(Protocol):
    """A sensor. Settings by name: exposure (100 us units), gain, and those of MANUAL that it has."""

    def set(self, name: str, value: float) -> None: ...

    def get(self, name: str) -> float | None:
        """None where the sensor has no such setting."""
        ...

    def frame(self, deadline_s: float) -> NDArray | None:
        """The next frame (H, W) or (H, W, C), linear counts; None where none comes in time."""
        ...

    @property
    def full_scale(self) -> float: ...

    def close(self) -> None: ...


class Camera:
    """read_noise in counts, k counts per electron. Call `configure` first."""

    def __init__(self, source: FrameSource, gain: float = 0.0, read_noise: float = 2.0, k: float = 1.0):
        self.source, self.gain, self.read_noise, self.k = source, gain, read_noise, k
        self.darks: dict[float, Array] = {}
        self.flat: Array | None = None
        self.bad: NDArray[np.bool_] | None = None
        self._exposure: float | None = None

    def configure(self) -> None:
        """Nothing automatic is left on. Raises DeviceFault that says what was set and what was found."""
        if self.source.get("auto_exposure") is not None:
            self.source.set("auto_exposure", 3)  # some drivers take manual only as a change
        for name, value in {**MANUAL, "gain": self.gain}.items():
            if self.source.get(name) is not None:
                self._put(name, value)

    def _put(self, name: str, value: float, tolerance: float = 0.5) -> None:
        self.source.set(name, value)
        found = self.source.get(name)
        if found is None or abs(found - value) > tolerance:
            raise DeviceFault(
                "camera", f"{name} set to {value:g} reads {found}", "close other programs that use it, or use another"
            )

    def frame(self, exposure: float) -> NDArray:
        """One settled frame of an exposure in seconds. Raises DeviceFault."""
        if exposure != self._exposure:
            self._put("exposure", round(exposure * 1e4), tolerance=max(0.5, exposure * 1e2))
            self._exposure = exposure
        return self.settled()

    def settled(self) -> NDArray:
        """The first frame that looks like the one before it; the buffered ones of before are gone then."""
        end = time.monotonic() + DEADLINE_S
        before = None
        for n in range(MOST):
            frame = self.source.frame(end - time.monotonic())
            if frame is None:
                raise DeviceFault("camera", "delivers no frames", "check its cable; plug it in again")
            mean = float(frame.mean())
            if before is not None and n >= LEAST and abs(mean - before) <= SETTLED * max(mean, before, 1.0) + 1e-12:
                return frame
            before = mean
        raise DeviceFault("camera", f"does not settle in {MOST} frames", "is the light flickering or something moving?")

    def learn_dark(self, exposures: tuple[float, ...], frames: int = 4) -> None:
        """With the light off: a dark frame of each exposure, and the hot pixels."""
        for t in exposures:
            self.darks[t] = np.mean([self.frame(t).astype(float) for _ in range(frames)], 0)
        self.bad = bad_pixels(self.darks[max(exposures)], None, self.read_noise)

    def learn_flat(self, exposures: tuple[float, ...]) -> None:
        """With something evenly bright before it: the vignetting, as a picture of mean 1."""
        self.flat = None
        value = self.picture(exposures).value
        self.flat = np.nan_to_num(value / np.nanmean(value, (0, 1)), nan=1.0)
        if self.bad is not None:
            self.bad |= bad_pixels(np.zeros_like(value), self.flat, self.read_noise)

    def picture(self, exposures: tuple[float, ...]) -> Picture:
        """A linear picture in counts per second, corrected for dark and flat; bad pixels are NaN."""
        frames = [self.frame(t) for t in exposures]
        darks = [self.darks.get(t, np.zeros(frames[0].shape)) for t in exposures]
        p = merge(frames, list(exposures), darks, self.source.full_scale, self.read_noise, self.k)
        flat = 1.0 if self.flat is None else self.flat
        value, sigma = p.value / flat, p.sigma / flat
        if self.bad is not None:
            value[self.bad], sigma[self.bad] = np.nan, np.nan
        return Picture(value, sigma, p.saturated)

    def close(self) -> None:
        self.source.close()


class CameraDetector:
    """Implements `gonio.rig.devices.Detector`: the mean over `region()`, rows and columns of the lit patch.

    Signals are counts in the nominal exposure, the dark frame already taken off.
    """

    def __init__(
        self, camera: Camera, exposures: tuple[float, ...], exposure: float, region: Callable[[], tuple[slice, slice]]
    ):
        self.camera, self.exposures, self.exposure, self.region = camera, exposures, exposure, region

    def expect(self, signal: Array | None) -> None:
        """Every bracket is taken anyway."""

    def read(self, exposure: float | None = None) -> Reading:
        seconds = exposure or self.exposure
        p = self.camera.picture(self.exposures)
        rows, columns = self.region()
        value, sigma = p.value[rows, columns], p.sigma[rows, columns]
        saturated = bool(p.saturated[rows, columns].any())
        good = np.isfinite(value).all(-1)
        if not good.any():
            raise DeviceFault("camera", "no good pixel in its region", "check the camera's calibration")
        n = int(good.sum())
        raw = {"exposure_s": seconds, "exposures_s": list(self.exposures), "pixels": n}
        return Reading(value[good].mean(0) * seconds, np.sqrt((sigma[good] ** 2).sum(0)) / n * seconds, saturated, raw)


def region_of(
    corners: Array, rotation: Array, translation: Array, calibration: Mapping[str, Array], size: tuple[int, int]
) -> tuple[slice, slice]:
    """Rows and columns that hold the patch with `corners` (N, 3), which stands to the camera at rotation (3,) and
    translation (3,) (OpenCV's rvec, tvec). calibration: matrix, distortion. Raises DeviceFault where it
    lies outside the picture of size (width, height).
    """
    import cv2

    matrix, distortion = np.asarray(calibration["matrix"]), np.asarray(calibration["distortion"])
    found, _ = cv2.projectPoints(np.asarray(corners, float), rotation, translation, matrix, distortion)
    points = np.asarray(found)[:, 0]
    low, high = np.floor(points.min(0)).astype(int), np.ceil(points.max(0)).astype(int)
    if (low < 0).any() or (high >= size).any():
        raise DeviceFault("camera", "the patch lies outside its picture", "aim it again, then `gonio calibrate camera`")
    return slice(low[1], high[1] + 1), slice(low[0], high[0] + 1)
