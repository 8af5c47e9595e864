"""Clocks of one form. A simulated rig spends rig seconds on the virtual one without spending CPU seconds."""

import threading
import time
from typing import Protocol

LEAST_S = 1e-4  # a shorter wait costs the machine more than it lasts
WAKES_LATE_S = 0.0015  # as whoever really sleeps does; servos count in ms and are there by then


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
    """The machine's clock on which waiting is `scale` times shorter: what a wait leaves out is added to `now`.

    For emulators that live faster than life. What the machine itself takes counts as what it is, so that seconds on
    this clock are those of a real rig driven by this machine; with a scale of 1 it is the machine's clock.
    """

    def __init__(self, scale: float):
        self.scale = scale
        self._skipped = 0.0
        self._lock = threading.Lock()

    def now(self) -> float:
        return time.monotonic() + self._skipped

    def sleep(self, seconds: float) -> None:
        """Waits of several threads run side by side: the longest counts."""
        if seconds > 0:
            end = self.now() + seconds + (WAKES_LATE_S if self.scale > 1 else 0.0)
            if seconds / self.scale > LEAST_S:
                time.sleep(seconds / self.scale)
            with self._lock:
                self._skipped += max(0.0, end - self.now())

    def hurry(self, seconds: float) -> float:
        """Somebody else waits so long: the machine seconds that is to take; the rest has passed when this returns."""
        with self._lock:
            self._skipped += seconds * (1 - 1 / self.scale)
        return seconds / self.scale
