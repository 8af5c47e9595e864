"""Clocks of one form. A simulated rig spends rig seconds on the virtual one without spending CPU seconds."""

import time
from typing import Protocol


class Clock(Protocol):
    """Seconds that only grow; the origin means nothing."""

    def now(self) -> float: ...

    def sleep(self, seconds: float) -> None: ...


class RealClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        if seconds > 0:
            time.sleep(seconds)


class VirtualClock:
    """A clock that jumps: sleeping costs nothing and moves `now` on."""

    def __init__(self, start: float = 0.0):
        self._now = start

    def now(self) -> float:
        return self._now

    def sleep(self, seconds: float) -> None:
        if seconds > 0:
            self._now += seconds


class ScaledClock:
    """The machine's clock, `scale` times as fast: for emulators that live faster than life."""

    def __init__(self, scale: float):
        self.scale = scale

    def now(self) -> float:
        return time.monotonic() * self.scale

    def sleep(self, seconds: float) -> None:
        if seconds > 0:
            time.sleep(seconds / self.scale)
