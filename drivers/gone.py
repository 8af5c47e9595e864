"""A port that is not there: one exception for the many ways in which an unplugged adapter shows itself."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

try:
    from termios import error as TermiosError
except ImportError:  # pragma: no cover - not a POSIX system
    TermiosError = OSError  # type: ignore[misc,assignment]


T = TypeVar("T")


class PortGone(OSError):
    """The serial port has vanished or cannot be opened."""

    exit_code = 3

    @property
    def taken(self) -> bool:
        """Whether it is there, but another program's."""
        return "lock" in str(self).lower() or "busy" in str(self).lower()


@contextmanager
def gone(name: str) -> Iterator[None]:
    """Turns OSError, SerialException, termios.error and what a closed file raises into PortGone."""
    try:
        yield
    except PortGone:
        raise
    except (OSError, TermiosError, TypeError, ValueError, AttributeError) as e:
        raise PortGone(f"{name}: {e}") from None


def outlast(act: Callable[[], T], bring_back: Callable[[], None], seconds: float) -> T:
    """`act`, done again from the beginning after each absence of its port.

    bring_back opens the port and makes the device what it was. Absences that follow each other, also while the device
    is being brought back, are one longer absence: together they may last `seconds`. Raises PortGone after that.
    """
    end: float | None = None
    while True:
        try:
            return act()
        except PortGone as e:
            end = end if end is not None else time.monotonic() + seconds
            if time.monotonic() > end or not wait_for(end - time.monotonic(), bring_back):
                raise e from None


def wait_for(seconds: float, opened: Callable[[], None]) -> bool:
    """Try `opened` until it succeeds or the time is over; whether it did."""
    end = time.monotonic() + seconds
    while True:
        try:
            opened()
            return True
        except PortGone:
            if time.monotonic() > end:
                return False
            time.sleep(0.02)
