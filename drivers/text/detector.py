"""An instrument that speaks text as the rig's detector: ranges found by trying, readings averaged to a target.

A signal of 1 is what `white` of the instrument's unit gives in the rig's nominal exposure. Watts, amperes and volts do
not grow with the time they are read for, as the signal of an exposure does: they are multiplied by the exposure over
the nominal one. Counts grow by themselves. A meter whose integration time cannot be set has one exposure; it is read
the same for any.
"""

import re
import time
from collections.abc import Iterator
from typing import TypeVar

import numpy as np

from drivers.gone import PortGone, outlast
from drivers.text.answers import Answer
from drivers.text.instrument import TextInstrument
from gonio.config.detectors import PhotodiodeConfig
from gonio.config.instrument import TextSection, as_sent, filled
from gonio.geometry import Array
from gonio.rig.clock import Clock
from gonio.rig.devices import Reading
from gonio.rig.signal.averaging import readings_needed, sigma_of

T = TypeVar("T")

FILL = 0.9  # of a range's full scale that is used
GRACE_S = 5.0


class TextDetector:
    """Implements `gonio.rig.devices.Detector`. Call `connect` first.

    noise: of a reading, in units of the signal, and how long to average (`photodiode` in the rig's YAML); exposure:
    the nominal one, s; clock: on which settling passes.
    """

    def __init__(
        self,
        section: TextSection,
        noise: PhotodiodeConfig,
        exposure: float,
        clock: Clock,
        grace_s: float = GRACE_S,
    ):
        self.section, self.noise, self.exposure, self.clock, self.grace_s = section, noise, exposure, clock, grace_s
        self.i = section.instrument
        self.instrument = TextInstrument(section)
        self.channels = section.channels
        self.full_scale = np.array(self.i.ranges.full_scale if self.i.ranges else [np.inf])
        marked = "overload" in re.compile(self.i.answer).groupindex
        self._marks = marked or self.i.overload is not None or self.i.overload_above is not None
        self._range = 0
        self._set: tuple[int, int, str] | None = None  # session, range, integration: as the instrument has them

    def connect(self) -> None:
        """Raises DeviceFault where it is not there, or not what its description says."""
        try:
            self.instrument.open()
        except PortGone as e:
            raise self.instrument.gone(e) from None

    def close(self) -> None:
        self.instrument.close()

    def expect(self, signal: Array | None) -> None:
        """Choose the range for what is to come: saves the trials."""
        if signal is not None and np.isfinite(signal).all():
            most = float(np.max(np.asarray(signal) + self.noise.dark)) * self.section.white
            self._range = self._fitting(most)

    def read(self, exposure: float | None = None) -> Reading:
        """Raises DeviceFault where nothing comes, or nothing that can be believed."""
        try:
            return outlast(lambda: self._read(exposure or self.exposure), self.instrument.open, self.grace_s)
        except PortGone as e:
            raise self.instrument.gone(e) from None

    def _read(self, exposure: float) -> Reading:
        seconds, integration = self._time(exposure)
        scale = self._scale(seconds)
        end = time.monotonic() + self.noise.average_s
        answer = self._in_range(integration, seconds)
        full = self.full_scale[self._range]
        first = self._values(answer, scale)
        total, n, overload = first.copy(), 1, self._clipped(answer)
        while not overload:
            _, variance, steps = self._noise(total / n, seconds, scale)
            light = np.maximum(total / n - self._dark(seconds), 0)
            if n >= readings_needed(self.noise, light, variance, steps, seconds) or time.monotonic() > end:
                break
            again = self.instrument.read(seconds)
            overload = self._clipped(again)
            if not again.overload:
                total, n = total + self._values(again, scale), n + 1
        value = total / n
        _, variance, steps = self._noise(value, seconds, scale)
        raw = {"exposure_s": seconds, "readings": n, "reply": answer.text[:200]}
        if np.isfinite(full):
            raw |= {"range": [self._range] * self.channels, "full_scale": [float(full * scale)] * self.channels}
        return Reading(value, sigma_of(variance, steps, n), overload, raw)

    def _clipped(self, answer: Answer) -> bool:
        """Whether it was too much: by its mark, or, of one that has none, by a number that fills the range."""
        if self._marks:
            return answer.overload
        return answer.overload or bool((np.abs(answer.values) >= self.full_scale[self._range]).any())

    def _scale(self, seconds: float) -> float:
        """What a number of the instrument's is multiplied by to be a signal."""
        return (1.0 if self.i.integrates else seconds / self.exposure) / self.section.white

    def _values(self, answer: Answer, scale: float) -> Array:
        """Signals (C,); of an overload the full scale, as far as it is known."""
        if answer.overload:
            full = self.full_scale[self._range]
            return np.full(self.channels, full * scale if np.isfinite(full) else np.nan)
        values = answer.values if self.section.bands is None else self.section.bands.binned(answer.values)
        return np.asarray(values * scale)

    def _dark(self, seconds: float) -> float:
        return self.noise.dark * seconds / self.exposure

    def _noise(self, value: Array, seconds: float, scale: float) -> tuple[Array, Array, Array]:
        """Light above dark, the variance of one reading, and that of the converter's steps, (C,) each."""
        c = self.noise
        light = np.maximum(value - self._dark(seconds), 0)
        full, steps = self.full_scale[self._range], self.i.steps
        step = full * scale / steps if steps and np.isfinite(full) else 0.0
        # the same reading whatever time was asked for, where it cannot be set: its noise grows with the signal
        same = seconds / self.exposure if self.i.integration is None and not self.i.integrates else 1.0
        variance = c.shot_noise**2 * light * same + (c.read_noise * same) ** 2
        return light, variance, np.full(self.channels, step**2 / 12)

    # ---- ranges and times ------------------------------------------------------------------------------------------

    def _time(self, exposure: float) -> tuple[float, str]:
        """The integration time that comes nearest, in s, and the command that sets it, "" where there is none."""
        t = self.i.integration
        if t is None:
            return exposure, ""
        value = as_sent(t.command, min(max(exposure / t.unit_s, t.lowest), t.highest))
        return value * t.unit_s, filled(t.command, value=value)

    def _in_range(self, integration: str, seconds: float) -> Answer:
        """A reading in the lowest range that holds it: the same range from wherever the search started."""
        top, floor = len(self.full_scale) - 1, 0
        while True:
            self._choose(integration, seconds)
            answer = self.instrument.read(seconds)
            r = self._range
            most = np.inf if answer.overload else float(np.abs(answer.values).max())
            if most > FILL * self.full_scale[r]:
                floor = min(r + 1, top)
                want = floor
            else:
                want = min(max(self._fitting(most), floor), r)
            if want == r:
                return answer
            self._range = want

    def _fitting(self, most: float) -> int:
        return min(int(np.searchsorted(FILL * self.full_scale, most)), len(self.full_scale) - 1)

    def _choose(self, integration: str, seconds: float) -> None:
        """Range and integration time as they should be; what was read before they settled is thrown away."""
        wanted = self.instrument.sessions, self._range, integration
        had, ranges = self._set, self.i.ranges
        if wanted == had:
            return
        self._set = None  # until all of it is known to be set
        new = had is None or had[0] != wanted[0]
        if integration and (new or had is None or had[2] != integration):
            self.instrument.order(integration)
        if ranges is not None and ranges.command and (new or had is None or had[1] != self._range):
            self.instrument.order(ranges.set(self._range))
            self.clock.sleep(ranges.settle_s)
            for _ in range(ranges.discard):
                self.instrument.read(seconds)
        self._set = wanted

    # ---- the doctor ------------------------------------------------------------------------------------------------

    def doctor(self) -> Iterator[str]:
        """Findings: who it is, one reading, and how much readings scatter. Raises DeviceFault."""
        self.connect()
        said = self.instrument.identity
        yield f"ok   {self.i.name}: on {self.section.port} says {said[:80]!r}"
        r = self.read()
        shown = ", ".join(f"{v * self.section.white:.5g}" for v in r.value[:8])
        more = f" and {self.channels - 8} more" if self.channels > 8 else ""
        yield f"ok   {self.i.name}: reads {shown}{more} {self.i.unit} ({r.raw['reply']!r})"
        if r.saturated:
            yield f"warn {self.i.name}: overload in its highest range; less light, or check `ranges`"
