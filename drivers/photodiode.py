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
from drivers.numbers import decimal, whole
from drivers.text_line import TextLine, shown
from gonio.config.detectors import PhotodiodeConfig
from gonio.geometry import Array
from gonio.rig.devices import Reading
from gonio.rig.errors import DeviceFault
from gonio.rig.signal.averaging import readings_needed, sigma_of

FILL = 0.9  # of a range's full scale that is used
ABOVE, BELOW = 1.25, 0.25  # of the full scale: beyond, no converter says so
RESTARTS = 3  # in one reading, and it is not well
MOST_CHANNELS = 64
PORT, FIRMWARE = "check devices.photodiode.port", "check its firmware and supply, then `gonio resume`"


class Restarted(Exception):
    """It is not as it was left: it has been reset, or set by somebody else."""


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
        *identity, channels = self.line.ask("*IDN?").split(",")
        try:
            self.channels = whole(channels)
            if len(identity) != 4 or not 1 <= self.channels <= MOST_CHANNELS:
                raise ValueError
        except ValueError:
            said = shown(",".join([*identity, channels]).encode())
            raise DeviceFault("photodiode", f"{self.line.port} says it is {said}", PORT) from None
        self._reset()

    def _reset(self) -> None:
        self.line.ask("*RST")
        answer = self.line.ask("CONF:FULL?")
        try:
            self.full_scale = np.array([decimal(x) for x in answer.split(",")])
            if not (self.full_scale[0] > 0 and (np.diff(self.full_scale) > 0).all()):
                raise ValueError
        except ValueError:
            raise DeviceFault("photodiode", f"has ranges of {shown(answer.encode())}", FIRMWARE) from None
        self.lsb = self.full_scale / 2**self.config.bits
        self._counter = 0
        self._ranges, self._unsettled = np.zeros(self.channels, np.int64), False

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
        first = self._in_range(seconds)
        samples, total = [first], first.signal.copy()
        while not samples[-1].overload.any():
            wanted = readings_needed(self.config, *self._noise(first, total / len(samples)), seconds)
            if len(samples) >= wanted or time.monotonic() > end:  # slower than it should be: what there is will do
                break
            samples.append(self._take(seconds))
            total += samples[-1].signal
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
        self._ranges, self._unsettled = np.array(ranges), True  # the first reading after a change is not to be believed

    def _take(self, seconds: float) -> Sample:
        """The next reading. After a restart (its plug was pulled) it is set up and asked again. Raises DeviceFault."""
        for _ in range(RESTARTS):
            try:
                if self._unsettled:
                    self._answer(0.0)
                    self._unsettled = False
                return self._answer(seconds)
            except Restarted as e:
                why, ranges = e, self._ranges
                self._reset()
                self._choose(ranges)
        raise DeviceFault("photodiode", f"is not as it was left, {RESTARTS} times in a row: {why}", FIRMWARE)

    def _answer(self, seconds: float) -> Sample:
        """One reading. Where its answer was lost, the reading is fetched, not made twice. Raises Restarted."""
        restarts = self.line.restarts
        for _ in range(4):
            text = self.line.ask(f"READ? {seconds:.6E}", seconds, again="FETC?")
            if self.line.restarts != restarts:
                raise Restarted("its port was opened anew")
            s = self._parse(text) if text else None  # nothing was read yet that could be fetched
            if s is not None and s.counter != self._counter:
                break
            # the command was lost, and what was fetched is the reading before
        if s is None:
            raise Restarted("it has nothing to fetch")
        if s.counter != self._counter + 1:
            raise Restarted(f"its counter reads {s.counter} after {self._counter}")
        if s.seconds != float(f"{seconds:.6E}"):
            raise Restarted(f"it exposed for {s.seconds:g} s in place of {seconds:g}")
        if not np.array_equal(s.ranges, self._ranges):
            raise Restarted(f"its ranges are {s.ranges.tolist()} in place of {self._ranges.tolist()}")
        self._counter += 1
        return s

    def _parse(self, text: str) -> Sample:
        """Raises DeviceFault for what no photodiode of these ranges can say."""
        try:
            counter, seconds, *rest = text.split(",")
            if len(rest) != 3 * self.channels:
                raise ValueError(f"{len(rest)} numbers in place of {3 * self.channels}")
            ranges = np.array([whole(x) for x in rest[0::3]])
            overload = np.array([whole(x) for x in rest[1::3]])
            signal = np.array([decimal(x) for x in rest[2::3]])
            if (ranges >= len(self.full_scale)).any() or (overload > 1).any():
                raise ValueError("a range or an overload that does not exist")
            full = self.full_scale[ranges]
            if ((signal > ABOVE * full) | (signal < -BELOW * full)).any():
                raise ValueError("a signal that its range cannot hold")
            return Sample(whole(counter), decimal(seconds), ranges, overload > 0, signal, text)
        except ValueError as e:
            raise DeviceFault("photodiode", f"answered {shown(text.encode())}: {e}", FIRMWARE) from None
