"""What an emulated meter reads: the light of a scene in its own unit, with the noise of `sim.photodiode`.

The noise of a measurement follows from its number, and starts anew with every change of range.
"""

from collections.abc import Callable

import numpy as np

from gonio.config.detectors import PhotodiodeConfig
from gonio.geometry import Array
from gonio.rig.clock import ScaledClock
from sim.noise import PHOTODIODE, generator


class Meter:
    """scene() is the signal (C,) per nominal exposure, dark not included; white: the unit that a signal of 1 reads."""

    def __init__(
        self,
        config: PhotodiodeConfig,
        scene: Callable[[], Array],
        white: float,
        seed: int,
        clock: ScaledClock,
        exposure: float = 0.02,
    ):
        self.config, self.scene, self.white, self.seed, self.clock = config, scene, white, seed, clock
        self.exposure = exposure
        self._unsettled = False
        self.announce(-1)

    def announce(self, number: int) -> None:
        """The measurement that the next readings are for."""
        self._number = number
        self._rng: np.random.Generator | None = None

    def settle(self) -> None:
        """Its range was changed: the next reading is not to be believed."""
        self._rng, self._unsettled = None, True

    def read(self, seconds: float | None = None) -> Array:
        """One reading (C,) in its unit, of so many seconds; None: the nominal exposure. Longer ones are less noisy."""
        scale = 1.0 if seconds is None else seconds / self.exposure
        c, light = self.config, self.scene() * scale
        if self._unsettled:  # the amplifier is still on its way
            self._unsettled = False
            return np.asarray((0.7 * light / scale + c.dark) * self.white)
        self._rng = self._rng or generator(self.seed, PHOTODIODE, self._number)
        z = self._rng.standard_normal((2, len(light)))
        noise = np.sqrt(np.maximum(light, 0)) * c.shot_noise * z[0] + c.read_noise * z[1]
        return np.asarray(((light + noise) / scale + c.dark) * self.white)
