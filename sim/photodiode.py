"""A simulated photodiode behind colour filters: shot, read and quantisation noise, automatic ranges, saturation.

The unit of signal is what a white diffuser (f = 1/pi) lit and seen along its normal gives in one nominal exposure. The
noise is that of the signal itself, S = pi f cos(theta_i) where the light overfills the detector's view: variance
shot^2 S + read^2, so that the same f is noisier at grazing light, as on a bench.
"""

from collections.abc import Callable

import numpy as np

from gonio.config.detectors import PhotodiodeConfig
from gonio.geometry import Array
from gonio.rig.clock import Clock
from gonio.rig.devices import Reading
from gonio.rig.errors import DeviceFault
from gonio.rig.signal.averaging import readings_needed, sigma_of
from sim.noise import PHOTODIODE, generator
from sim.world import TrueRig


class SimPhotodiode:
    """Implements `gonio.rig.devices.Detector`. `scene()` is the signal (C,) per nominal exposure, dark not included."""

    def __init__(
        self,
        config: PhotodiodeConfig,
        scene: Callable[[], Array],
        clock: Clock,
        exposure: float,
        seed: int,
        *,
        silent: float = 0.0,
        spike: float = 0.0,
        true: TrueRig | None = None,
    ):
        self.true = true
        self.config, self.scene, self.clock, self.exposure, self.seed = config, scene, clock, exposure, seed
        self.silent, self.spike = silent, spike
        self.full_scale = config.full_scale * config.range_factor ** np.arange(config.ranges)
        self.lsb = self.full_scale / 2**config.bits
        self._range: Array | None = None
        self.announce(-1)

    def announce(self, number: int) -> None:
        """The measurement that the next readings are for; their noise follows from it."""
        self._number = number
        self._rng: np.random.Generator | None = None

    def expect(self, signal: Array | None) -> None:
        if signal is not None:
            self._range = self._fitting(signal + self.config.dark)

    def read(self, exposure: float | None = None) -> Reading:
        """A reading, averaged as the config says; a change of range costs another exposure.

        Raises DeviceFault when nothing comes.
        """
        c = self.config
        seconds = exposure or self.exposure
        scale = seconds / self.exposure
        rng = self._rng = self._rng or generator(self.seed, PHOTODIODE, self._number)
        light = self.scene() * scale
        z = rng.standard_normal((2, len(light)))
        self.clock.sleep(seconds)
        if self.silent and rng.random() < self.silent:
            raise DeviceFault("photodiode", "no reply", "check its cable and supply")
        dark = self._dark() * scale
        signal = light + dark + np.sqrt(np.maximum(light, 0)) * c.shot_noise * z[0]
        if self.spike and rng.random() < self.spike:
            signal = signal * 10
        ranges = self._fitting(signal)
        if self._range is not None and not np.array_equal(ranges, self._range):
            self.clock.sleep(seconds)  # the first reading after a change is thrown away
        self._range = ranges
        full, lsb = self.full_scale[ranges], self.lsb[ranges]
        counts = total = self._counts(signal, ranges, z[1])
        n = 1
        while True:
            value = total / n * lsb
            above, variance, steps = self._noise(value, lsb, scale)
            saturated = bool((counts >= 2**c.bits - 1).any())
            if saturated or n >= readings_needed(c, above, variance, steps, seconds):
                break
            z = rng.standard_normal((2, len(light)))
            self.clock.sleep(seconds)
            signal = light + dark + np.sqrt(np.maximum(light, 0)) * c.shot_noise * z[0]
            counts = self._counts(signal, ranges, z[1])
            n, total = n + 1, total + counts
        raw = {
            "counts": total.astype(int).tolist(),
            "range": ranges.tolist(),
            "full_scale": full.tolist(),
            "exposure_s": seconds,
            "readings": n,
        }
        return Reading(value, sigma_of(variance, steps, n), saturated, raw)

    def _dark(self) -> float:
        c = self.config
        return c.dark + (0.0 if self.true is None else self.true.dark(c.dark, self.clock.now()))

    def _counts(self, signal: Array, ranges, z: Array) -> Array:
        """What the converter makes of a signal on its ranges."""
        c, full, lsb = self.config, self.full_scale[ranges], self.lsb[ranges]
        if self.true is not None:
            signal = self.true.converted(signal, ranges, full)
        shown = signal * (1 + c.nonlinearity * signal / full) + c.read_noise * z
        return np.clip(np.rint(shown / lsb), 0, 2**c.bits - 1)

    def _noise(self, value: Array, lsb: Array, scale: float) -> tuple[Array, Array, Array]:
        """Light above dark, the variance of one reading, and that of the converter's steps, (C,) each."""
        c = self.config
        light = np.maximum(value - c.dark * scale, 0)
        return light, c.shot_noise**2 * light + c.read_noise**2, lsb**2 / 12

    def state(self) -> dict:
        return {"range": None if self._range is None else self._range.tolist()}

    def restore(self, state: dict) -> None:
        self._range = None if state["range"] is None else np.array(state["range"])

    def _fitting(self, signal: Array):
        """The lowest range (C,) that holds the signal."""
        return np.minimum(np.searchsorted(self.full_scale, signal), self.config.ranges - 1)
