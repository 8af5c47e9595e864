"""An emulated photodiode: the noise model of `sim.photodiode`, ranges set by the host, text on a line.

The noise of a measurement follows from its number, and starts anew with every change of range: the first settled
reading of a measurement in a range is the same by whatever way the host came to that range.
"""

from collections.abc import Callable

import numpy as np

from gonio.config.detectors import PhotodiodeConfig
from gonio.geometry import Array
from gonio.rig.clock import ScaledClock
from sim.noise import PHOTODIODE, generator
from sim.wire.text import TextDevice
from sim.world import TrueRig


class WirePhotodiode(TextDevice):
    """scene() is the signal (C,) per nominal exposure, dark not included; exposures pass on `clock`."""

    def __init__(
        self,
        config: PhotodiodeConfig,
        scene: Callable[[], Array],
        channels: int,
        exposure: float,
        seed: int,
        clock: ScaledClock,
        true: TrueRig | None = None,
    ):
        self.true = true
        super().__init__(
            {
                "*IDN?": lambda _: f"gonio,photodiode,0,1,{channels}",
                "*RST": self._reset,
                "CONF:FULL?": lambda _: ",".join(f"{x:.6E}" for x in self.full_scale),
                "CONF:RANG": self._set_ranges,
                "READ?": self._read,
                "FETC?": lambda _: self.last,
                "SYST:ERR?": lambda _: '0,"No error"',
            }
        )
        self.config, self.scene, self.channels, self.exposure = config, scene, channels, exposure
        self.seed, self.clock = seed, clock
        self.capped, self.frozen, self.ambient = False, False, 0.0  # a cap on it; stuck at its last value; room light
        self.full_scale = config.full_scale * config.range_factor ** np.arange(config.ranges)
        self.lsb = self.full_scale / 2**config.bits
        self._reset("")
        self.announce(-1)

    def announce(self, number: int) -> None:
        """The measurement that the next readings are for."""
        self._number = number
        self._rng: np.random.Generator | None = None

    def power_on(self) -> None:
        self._reset("")

    def _reset(self, _: str) -> str:
        self.counter, self.last = 0, ""
        self.ranges = np.zeros(self.channels, int)
        self._unsettled = False
        return ""

    def _set_ranges(self, text: str) -> str:
        ranges = np.array([int(x) for x in text.split(",")])
        if len(ranges) != self.channels or not ((ranges >= 0) & (ranges < len(self.full_scale))).all():
            raise ValueError(text)
        if not np.array_equal(ranges, self.ranges):
            self.ranges, self._unsettled, self._rng = ranges, True, None
        return ",".join(map(str, ranges.tolist()))

    def _read(self, text: str) -> str:
        c = self.config
        seconds = float(text)
        self.busy_s = self.clock.hurry(seconds)
        scale = seconds / self.exposure
        light = (np.zeros(self.channels) if self.capped else self.scene()) * scale + self.ambient * scale
        if self._unsettled:  # the amplifier is still on its way
            z, light = np.zeros((2, len(light))), 0.7 * light
            self._unsettled = False
        else:
            self._rng = self._rng or generator(self.seed, PHOTODIODE, self._number)
            z = self._rng.standard_normal((2, len(light)))
        dark = c.dark + (0.0 if self.true is None else self.true.dark(c.dark, self.clock.now()))
        signal = light + dark * scale + np.sqrt(np.maximum(light, 0)) * c.shot_noise * z[0]
        full, lsb = self.full_scale[self.ranges], self.lsb[self.ranges]
        if self.true is not None:
            signal = self.true.converted(signal, self.ranges, full)
        shown = signal * (1 + c.nonlinearity * signal / full) + c.read_noise * z[1]
        counts = np.clip(np.rint(shown / lsb), 0, 2**c.bits - 1)
        self.counter += 1
        if self.frozen and self.last:
            _, _, values = self.last.split(",", 2)
            self.last = f"{self.counter},{seconds:.6E},{values}"
            return self.last
        each = zip(self.ranges.tolist(), (counts >= 2**c.bits - 1).tolist(), (counts * lsb).tolist())
        self.last = f"{self.counter},{seconds:.6E}," + ",".join(f"{r},{int(o)},{v:.9E}" for r, o, v in each)
        return self.last
