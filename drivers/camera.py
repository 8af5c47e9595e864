"""The camera: settings made and read back, frames thrown away until they have settled, dark and flat ones learnt.

Everything here is above `FrameSource`, the seam under which lies OpenCV's VideoCapture or an emulated sensor. What a
reading is made of is `drivers.camera_detector`'s business.
"""

import time
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from drivers.hdr import Picture, bad_pixels, in_the_middle, merge
from gonio.config.detectors import CameraConfig
from gonio.rig.errors import DeviceFault
from gonio.rig.signal.frames import Frames

SETTLED = 0.02  # relative difference of two frames' means that counts as none
MOST = 24  # frames beyond those thrown away anyway
AVERAGED = 8  # frames that make a dark one, pictures that make a flat one

MANUAL = {"auto_exposure": 1, "auto_white_balance": 0, "autofocus": 0, "sharpness": 0, "gamma": 100}
Window = tuple[slice, slice]


class FrameSource(Protocol):
    """A sensor. Settings by name: exposure (100 us units), gain, white_balance, and those of MANUAL that it has."""

    def set(self, name: str, value: float) -> None: ...

    def get(self, name: str) -> float | None:
        """None where the sensor has no such setting."""
        ...

    def frame(self, deadline_s: float) -> NDArray | None:
        """The next frame (H, W) or (H, W, P), linear counts; None where none comes in time."""
        ...

    @property
    def full_scale(self) -> float: ...

    def describe(self) -> tuple[str, list[str]]:
        """What it says it is, and the formats that it offers."""
        ...

    def close(self) -> None: ...


class Camera:
    """One sensor, used as `config` says. Call `configure`, then `learn_dark` or `use`, first. Frames have P planes."""

    def __init__(self, source: FrameSource, config: CameraConfig):
        self.source, self.config = source, config
        s = config.sensor
        self.k = 1 / s.electrons_per_count  # counts per electron
        self.read_noise = float(np.hypot(s.read_noise * self.k, 0.29))  # counts; with that of the rounding
        self.frames: Frames | None = None

    def configure(self) -> None:
        """Nothing automatic is left on. Raises DeviceFault that says what was set and what was found."""
        if self.source.get("auto_exposure") is not None:
            self.source.set("auto_exposure", 3)  # some drivers take manual only as a change
        wanted = {**MANUAL, "gain": self.config.gain}
        if self.config.white_balance_k is not None:
            if self.source.get("white_balance") is None:
                raise DeviceFault("camera", "has no white balance to set", "set camera.white_balance_k to null")
            wanted["white_balance"] = self.config.white_balance_k
        for name, value in wanted.items():
            if self.source.get(name) is not None:
                self._put(name, value)

    def _put(self, name: str, value: float, tolerance: float = 0.5) -> None:
        self.source.set(name, value)
        found = self.source.get(name)
        if found is None or abs(found - value) > tolerance:
            raise DeviceFault(
                "camera", f"{name} set to {value:g} reads {found}", "close other programs that use it, or use another"
            )

    # ---- frames ----------------------------------------------------------------------------------------------------

    def frame(self, exposure: float, window: Window = (slice(None), slice(None))) -> NDArray:
        """The window (h, w, P) of a settled frame of an exposure in seconds: whatever went before is forgotten.

        Frames under way are thrown away, then more of them until two running look alike. Raises DeviceFault.
        """
        self._put("exposure", round(exposure * 1e4), tolerance=max(0.5, exposure * 1e2))
        each = max(exposure, self.config.frame_s)
        end = time.monotonic() + self.config.deadline_s + (self.config.discard_frames + 2) * each
        before: NDArray | None = None
        for n in range(self.config.discard_frames + MOST):
            frame = self._next(end)[window]
            if n >= self.config.discard_frames and before is not None and self._alike(frame, before):
                return frame
            before = frame
        raise DeviceFault("camera", f"unsettled after {n + 1} frames", "is the light flickering or something moving?")

    def more(self, exposure: float) -> NDArray:
        """The next frame after `frame`, nothing having changed."""
        return self._next(time.monotonic() + self.config.deadline_s + 2 * max(exposure, self.config.frame_s))

    def _next(self, end: float) -> NDArray:
        frame = self.source.frame(max(end - time.monotonic(), 0.0))
        if frame is None:
            raise DeviceFault("camera", "delivers no frames", "check its cable; plug it in again, then `gonio resume`")
        return np.atleast_3d(frame)

    def _alike(self, a: NDArray, b: NDArray) -> bool:
        """Their means differ by no more than SETTLED of what is above the darkest pixel, or than their noise."""
        mean, light = float(a.mean()), float(a.mean() - min(a.min(), b.min()))
        noise = np.sqrt(2 * (self.read_noise**2 + self.k * max(light, 0)) / max(a.size, 1))
        return abs(mean - float(b.mean())) <= SETTLED * light + 5 * noise

    # ---- what is the camera's own ----------------------------------------------------------------------------------

    def use(self, frames: Frames) -> None:
        """Dark and flat frames and bad pixels as measured before."""
        self.frames = frames

    def learn_dark(self) -> None:
        """With the light off: a dark frame of each exposure, and the hot pixels."""
        darks = []
        for t in self.config.exposure_s:
            first = self.frame(t).astype(float)
            darks.append((first + sum(self.more(t).astype(float) for _ in range(AVERAGED - 1))) / AVERAGED)
        bad = bad_pixels(darks[-1], None, self.read_noise)
        flat = None if self.frames is None else self.frames.flat
        self.frames = Frames(self.config.exposure_s, np.stack(darks), AVERAGED, bad, flat)

    @property
    def middle_exposure(self) -> float:
        return self.config.exposure_s[len(self.config.exposure_s) // 2]

    def learn_flat(self) -> None:
        """With something evenly bright before it, after `learn_dark`: the vignetting, 1 in the middle.

        Raises DeviceFault where that is too bright or too dark.
        """
        dark = self.known()
        plain = Frames(dark.exposures, dark.dark, dark.averaged, np.zeros_like(dark.bad))
        self.frames = plain
        pictures = [self.picture(range(len(dark.exposures))) for _ in range(AVERAGED)]
        p, value = pictures[0], np.mean([p.value for p in pictures], 0)
        if p.saturated.mean() > 0.01 or value.mean() < 5 * p.sigma.mean():
            raise DeviceFault("camera", "sees no even surface", "let one fill its picture, neither dark nor glaring")
        flat = value / in_the_middle(value, ~dark.bad)
        bad = dark.bad | bad_pixels(np.zeros_like(flat), flat, self.read_noise)
        self.frames = Frames(dark.exposures, dark.dark, dark.averaged, bad, np.where(bad[..., None], 1.0, flat))

    def known(self) -> Frames:
        if self.frames is None:
            raise DeviceFault("camera", "its dark frames are not known", "`gonio calibrate camera --frames`")
        return self.frames

    # ---- pictures --------------------------------------------------------------------------------------------------

    def picture(self, ladder: range, window: Window = (slice(None), slice(None))) -> Picture:
        """A linear picture (h, w, P) in counts per second from exposures of the ladder, by number."""
        return self.merged({n: self.frame(self.config.exposure_s[n], window) for n in ladder}, window)

    def merged(self, taken: dict[int, NDArray], window: Window) -> Picture:
        """The picture of frames taken, corrected for dark and flat; bad pixels are NaN. Keys: numbers in the ladder."""
        frames = self.known()
        numbers = sorted(taken)
        darks = [frames.dark[n][window] for n in numbers]
        read = self.read_noise * np.sqrt(1 + 1 / frames.averaged)
        exposures = [self.config.exposure_s[n] for n in numbers]
        p = merge([taken[n] for n in numbers], exposures, darks, self.source.full_scale, read, self.k)
        flat = 1.0 if frames.flat is None else frames.flat[window]
        value, sigma, bad = p.value / flat, p.sigma / flat, frames.bad[window]
        value[bad], sigma[bad] = np.nan, np.nan
        return Picture(value, sigma, p.saturated)

    def close(self) -> None:
        self.source.close()
