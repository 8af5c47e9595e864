"""The photodiode: ranges found by trying, each range's first reading thrown away, readings averaged to a target.

    *IDN?          -> *IDN? maker,model,serial,firmware,channels
    *RST           -> *RST                                         lowest ranges, counter 0
    CONF:FULL?     -> CONF:FULL? full scale of each range
    CONF:RANG r,.. -> CONF:RANG r,..                                one range per channel
    READ? t        -> READ? counter,t,range,overload,signal,range,overload,signal,..      exposes for t seconds
    FETC?          -> FETC? the last reading again

Signals are NR3, in the instrument's own unit.
"""

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.gone import PortGone
from drivers.text_line import Refused, TextLine
from gonio.config.rig import PhotodiodeConfig
from gonio.geometry import Array
from gonio.rig.devices import Reading
from gonio.rig.errors import DeviceFault
from gonio.rig.signal.averaging import readings_needed, sigma_of

FILL = 0.9  # of a range's full scale that is used


@dataclass(frozen=True)
class Sample:
    """One answer, checked: ranges (C,), overload (C,), signal (C,)."""

    counter: int
    seconds: float
    ranges: NDArray[np.int64]
    overload: NDArray[np.bool_]
    signal: Array
    text: str


class Photodiode:
    """Implements `gonio.rig.devices.Detector`. Noise figures as in the config, for sigma. Call `connect` first."""

    def __init__(self, line: TextLine, config: PhotodiodeConfig, exposure: float):
        self.line, self.config, self.exposure = line, config, exposure
        self.channels = 0

    def connect(self) -> None:
        """Raises DeviceFault where it is not there or not a photodiode."""
        try:
            self.line.open()
        except PortGone as e:
            raise self.line.gone(e) from None
        identity = self.line.ask("*IDN?").split(",")
        if len(identity) != 5 or not identity[4].isdigit():
            raise DeviceFault(
                "photodiode", f"{self.line.port} says it is {','.join(identity)!r}", "check devices.photodiode.port"
            )
        self.channels = int(identity[4])
        self._reset()

    def _reset(self) -> None:
        self.line.ask("*RST")
        self.full_scale = np.array([float(x) for x in self.line.ask("CONF:FULL?").split(",")])
        self.lsb = self.full_scale / 2**self.config.bits
        self._counter = 0
        self._ranges = np.zeros(self.channels, np.int64)

    def close(self) -> None:
        self.line.close()

    def expect(self, signal: Array | None) -> None:
        """Choose the ranges for what is to come: saves the trials."""
        if signal is not None:
            fitting = np.searchsorted(FILL * self.full_scale, np.asarray(signal) + self.config.dark)
            self._choose(np.minimum(fitting, len(self.full_scale) - 1))

    def read(self, exposure: float | None = None) -> Reading:
        """Raises DeviceFault where nothing comes, or nothing that can be believed."""
        seconds = exposure or self.exposure
        end = time.monotonic() + self.config.average_s
        try:
            first = self._in_range(seconds)
            samples, total = [first], first.signal.copy()
            while not samples[-1].overload.any():
                wanted = readings_needed(self.config, *self._noise(first, total / len(samples)), seconds)
                if len(samples) >= wanted or time.monotonic() > end:  # slower than it should be: what there is will do
                    break
                samples.append(self._take(seconds))
                total += samples[-1].signal
        except Refused as e:
            raise DeviceFault("photodiode", str(e), "see its manual, then `gonio resume`") from None
        value = total / len(samples)
        raw = {
            "counter": samples[-1].counter,
            "range": first.ranges.tolist(),
            "full_scale": self.full_scale[first.ranges].tolist(),
            "exposure_s": seconds,
            "readings": len(samples),
            "reply": first.text,
        }
        overload = any(bool(s.overload.any()) for s in samples)
        _, variance, steps = self._noise(first, value)
        return Reading(value, sigma_of(variance, steps, len(samples)), overload, raw)

    def _noise(self, s: Sample, value: Array) -> tuple[Array, Array, Array]:
        """Light above dark, the variance of one reading, and that of the converter's steps, (C,) each."""
        c = self.config
        light = np.maximum(value - c.dark * s.seconds / self.exposure, 0)
        return light, c.shot_noise**2 * light + c.read_noise**2, self.lsb[s.ranges] ** 2 / 12

    def _in_range(self, seconds: float) -> Sample:
        """The first reading in the lowest ranges that hold it: the same ranges from wherever the search started."""
        top = len(self.full_scale) - 1
        floor = np.zeros(self.channels, np.int64)
        while True:
            s = self._take(seconds)
            r = s.ranges
            over = s.overload | (s.signal > FILL * self.full_scale[r])
            floor = np.where(over, np.minimum(r + 1, top), floor)
            # a coarser range errs by its steps and its linearity: better to try once too often
            slack = 1 + 2 * abs(self.config.nonlinearity)
            might = s.signal[:, None] <= FILL * self.full_scale * slack + 2 * self.lsb[r][:, None]
            want = np.where(over, floor, np.minimum(np.maximum(might.argmax(1), floor), r))
            if np.array_equal(want, r):
                return s
            self._choose(want)

    def _choose(self, ranges: NDArray[np.int64]) -> None:
        if np.array_equal(ranges, self._ranges):
            return
        text = ",".join(map(str, ranges.tolist()))
        if self.line.ask(f"CONF:RANG {text}") != text:
            raise DeviceFault("photodiode", f"does not take the ranges {text}", "see its manual")
        self._ranges = np.array(ranges)
        self._take(0.0)  # the first after a change is not to be believed

    def _take(self, seconds: float) -> Sample:
        """The next reading. Where its answer was lost, the reading is fetched, not made twice."""
        for _ in range(4):
            text = self.line.ask(f"READ? {seconds:.6E}", seconds, again="FETC?")
            s = self._parse(text)
            if s.counter == self._counter + 1 and s.seconds == float(f"{seconds:.6E}"):
                self._counter += 1
                if np.array_equal(s.ranges, self._ranges):
                    return s
                break
            if s.counter != self._counter:
                break  # it has counted without us: it was reset
        ranges = self._ranges
        self._reset()  # somebody pulled its plug: from the beginning
        self._choose(ranges)
        return self._take(seconds)

    def _parse(self, text: str) -> Sample:
        try:
            head = text.split(",")
            numbers = np.array([float(x) for x in head[2:]]).reshape(self.channels, 3)
            return Sample(
                int(head[0]),
                float(head[1]),
                numbers[:, 0].astype(np.int64),
                numbers[:, 1] > 0,
                numbers[:, 2].copy(),
                text,
            )
        except ValueError:
            raise DeviceFault("photodiode", f"answered {text!r}", "check its firmware") from None
