"""A simulated sensor under the camera driver: the lit sample with vignetting, noise, hot pixels, bits, saturation.

What was set takes effect `delay` frames later, as with the buffers of a real one; a frame across the change is a mix of
both (rolling shutter).
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array

SETTINGS = {
    "auto_exposure": 3.0, "exposure": 156.0, "gain": 64.0, "auto_white_balance": 1.0, "autofocus": 1.0,
    "sharpness": 3.0, "gamma": 100.0,
}  # fmt: skip


class SimFrames:
    """scene() is the radiance (C,) of the patch, or a picture (H, W, C), in electrons per second and pixel."""

    def __init__(
        self,
        scene: Callable[[], Array],
        *,
        shape: tuple[int, int] = (48, 64),
        bits: int = 12,
        electrons_per_count: float = 2.0,
        read_noise: float = 3.0,
        dark_per_s: float = 20.0,
        vignetting: float = 0.3,
        hot: int = 5,
        delay: int = 3,
        seed: int = 0,
    ):
        self.scene, self.shape, self.bits, self.delay = scene, shape, bits, delay
        self.electrons, self.read_noise, self.dark_per_s = electrons_per_count, read_noise, dark_per_s
        self.rng = np.random.default_rng(seed)
        y, x = np.meshgrid(np.linspace(-1, 1, shape[0]), np.linspace(-1, 1, shape[1]), indexing="ij")
        self.gain_map = (1 - vignetting * (x * x + y * y) / 2)[..., None]
        self.hot = self.rng.choice(shape[0] * shape[1], hot, replace=False)
        self.settings = dict(SETTINGS)
        self.stubborn: set[str] = set()  # settings that do not change
        self.dead = False
        self._queue = [self._expose(self.settings["exposure"] * 1e-4)] * delay

    @property
    def full_scale(self) -> float:
        return float(2**self.bits - 1)

    def set(self, name: str, value: float) -> None:
        if name not in self.stubborn:
            self.settings[name] = float(value)

    def get(self, name: str) -> float | None:
        return self.settings.get(name)

    def frame(self, deadline_s: float) -> NDArray | None:
        if self.dead:
            return None
        self._queue.append(self._expose(self.settings["exposure"] * 1e-4))
        clean = self._queue.pop(0)
        if not np.array_equal(clean.shape, self._queue[0].shape):
            return None
        rows = int(self.rng.integers(self.shape[0]))
        changed = abs(clean.mean() - self._queue[0].mean()) > 0.2 * clean.mean()
        if changed:  # the change runs through this frame
            clean = np.concatenate([clean[:rows], self._queue[0][rows:]])
        electrons = self.rng.poisson(np.minimum(clean, 1e9)) + self.rng.normal(0, self.read_noise, clean.shape)
        counts = np.clip(np.rint(electrons / self.electrons + 16), 0, self.full_scale)
        return counts.astype(np.uint8 if self.bits <= 8 else np.uint16)

    def _expose(self, seconds: float) -> Array:
        """Electrons (H, W, C) without noise."""
        light = np.broadcast_to(self.scene(), (*self.shape, np.shape(self.scene())[-1]))
        electrons = (light * self.gain_map + self.dark_per_s) * seconds
        flat = electrons.reshape(-1, electrons.shape[-1])
        flat[self.hot] += 4000 * seconds
        return electrons

    def close(self) -> None:
        self.dead = True
