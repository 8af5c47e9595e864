"""A simulated sensor under the camera driver: noise, hot pixels, bits, saturation, frames that lag behind.

What was set takes effect `delay_frames` later, as with the buffers of a real one, and so does a change of what is seen;
a frame across a change is a mix of both (rolling shutter). The noise of a frame follows from the measurement it is for,
the exposure set when it is asked for, and how many were asked for so: it is the same by whatever way the driver came
there.
"""

from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from gonio.config.detectors import SensorConfig
from gonio.geometry import Array
from gonio.rig.clock import Clock, VirtualClock
from sim.noise import CAMERA, generator

SETTINGS = {
    "auto_exposure": 3.0, "exposure": 156.0, "gain": 64.0, "auto_white_balance": 1.0, "white_balance": 4600.0,
    "autofocus": 1.0, "sharpness": 3.0, "gamma": 100.0,
}  # fmt: skip
HOT = 4000.0  # electrons per second
MUTE = 1 << 40  # no exposure: where it is drawn whether a measurement's frames come


class SimFrames:
    """Implements `drivers.camera.FrameSource`. Frames are (H, W, P).

    scene() is the radiance (P,) of an evenly bright picture, or a picture (H, W, P), in electrons per second and pixel.
    frame_s of the clock pass from frame to frame, or the exposure if that is longer. silent: the share of measurements
    whose frames never come.
    """

    def __init__(
        self,
        scene: Callable[[], Array],
        sensor: SensorConfig,
        shape: tuple[int, int, int] = (48, 64, 3),
        clock: Clock | None = None,
        frame_s: float = 1 / 30,
        seed: int = 0,
        silent: float = 0.0,
    ):
        self.scene, self.sensor, self.frame_s, self.seed, self.silent = scene, sensor, frame_s, seed, silent
        self.shape, self.planes = shape[:2], shape[2]
        self.clock = clock or VirtualClock()
        y, x = np.meshgrid(np.linspace(-1, 1, shape[0]), np.linspace(-1, 1, shape[1]), indexing="ij")
        self.gain_map = (1 - sensor.vignetting * (x * x + y * y) / 2)[..., None]
        self.hot = generator(seed, CAMERA, -1).choice(shape[0] * shape[1], sensor.hot_pixels, replace=False)
        self.settings = dict(SETTINGS)
        self.stubborn: set[str] = set()  # settings that do not change
        self.dead = False  # whether frames have ceased to come
        self.dies_after: int | None = None  # frames until then
        self.delivered = 0
        self._queue: list[Array] = []
        self.announce(-1)

    @property
    def full_scale(self) -> float:
        return float(2**self.sensor.bits - 1)

    def describe(self) -> tuple[str, list[str]]:
        return "simulated camera", [f"{self.sensor.bits} bits linear"]

    @contextmanager
    def even(self, seconds: float) -> Iterator[None]:
        """Somebody holds a diffuser before the lens that lights all pixels alike, half full at that exposure."""
        scene, self.scene = self.scene, lambda: np.full(self.planes, rate)
        rate = 0.5 * self.full_scale * self.sensor.electrons_per_count / seconds
        try:
            yield
        finally:
            self.scene = scene

    def announce(self, number: int) -> None:
        """The measurement that the next frames are for."""
        self._number = number
        self._mute = number >= 0 and generator(self.seed, CAMERA, number, MUTE).random() < self.silent
        self._count: Counter[int] = Counter()

    def set(self, name: str, value: float) -> None:
        if name not in self.stubborn:
            self.settings[name] = float(value)

    def get(self, name: str) -> float | None:
        return self.settings.get(name)

    def frame(self, deadline_s: float) -> NDArray | None:
        if self.dies_after is not None and self.delivered >= self.dies_after:
            self.dead = True
        if self.dead or self._mute:
            self.clock.sleep(deadline_s)
            return None
        self.delivered += 1
        units = round(self.settings["exposure"])
        self.clock.sleep(max(units * 1e-4, self.frame_s))
        self._queue.append(self._expose(units * 1e-4))
        while len(self._queue) <= self.sensor.delay_frames:
            self._queue.insert(0, self._queue[0])
        clean = self._queue.pop(0)
        after = self._queue[0] if self._queue else clean
        rng = generator(self.seed, CAMERA, self._number, units, self._count[units])
        self._count[units] += 1
        if clean is not after and not np.array_equal(clean, after):  # the change runs through this frame
            row = int(rng.integers(self.shape[0]))
            clean = np.concatenate([clean[:row], after[row:]])
        s = self.sensor
        electrons = rng.poisson(np.minimum(clean, 1e9)) + s.read_noise * rng.standard_normal(clean.shape)
        counts = np.clip(np.rint(electrons / s.electrons_per_count + s.offset), 0, self.full_scale)
        return counts.astype(np.uint8 if s.bits <= 8 else np.uint16)

    def _expose(self, seconds: float) -> Array:
        """Electrons (H, W, P) without noise."""
        light = np.asarray(self.scene(), float)
        electrons = (
            np.broadcast_to(light * self.gain_map + self.sensor.dark_per_s, (*self.shape, self.planes)) * seconds
        )
        electrons.reshape(-1, self.planes)[self.hot] += HOT * seconds
        return electrons

    def close(self) -> None:
        self.dead = True
