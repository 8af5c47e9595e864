"""The serial port under dynamixel-sdk: opened for one owner only, waiting without burning the processor.

Whatever the kernel says when the adapter is unplugged (OSError, SerialException, termios.error, select on a closed
file) becomes PortGone.
"""

import os
import select
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import serial
from dynamixel_sdk import PortHandler

try:
    from termios import error as TermiosError
except ImportError:  # pragma: no cover - not a POSIX system
    TermiosError = OSError  # type: ignore[misc,assignment]

BAUDS = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)


class PortGone(OSError):
    """The serial port has vanished or cannot be opened."""


@contextmanager
def gone(name: str) -> Iterator[None]:
    """Turns every way in which a port can be missing into PortGone."""
    try:
        yield
    except PortGone:
        raise
    except (OSError, TermiosError, TypeError, ValueError, AttributeError) as e:
        raise PortGone(f"{name}: {e}") from None


class Port(PortHandler):
    """A PortHandler on the monotonic clock. Only whoever holds the bus's lock may use it."""

    def __init__(self, name: str, baud: int):
        super().__init__(name)
        self.baudrate = baud

    def setupPort(self, cflag_baud: int) -> bool:
        self.close()
        with gone(self.port_name):
            self.ser = serial.Serial(self.port_name, self.baudrate, timeout=0, write_timeout=0.5, exclusive=True)
            self.ser.reset_input_buffer()
        self.is_open = True
        self.tx_time_per_byte = 10_000.0 / self.baudrate  # ms
        return True

    def close(self) -> None:
        """Let go of it, whatever state it is in."""
        self.is_open = self.is_using = False
        if self.ser is not None:
            try:
                self.ser.close()
            except (OSError, TermiosError):
                pass
            self.ser = None

    def clearPort(self) -> None:
        with gone(self.port_name):
            self.ser.reset_input_buffer()

    def writePort(self, packet: Any) -> int:
        with gone(self.port_name):
            return int(self.ser.write(bytes(packet)))

    def readPort(self, length: int) -> bytes:
        """What has come, at most `length` bytes; waits for the first of it until the packet's deadline."""
        with gone(self.port_name):
            left = (self.packet_timeout - self.getTimeSinceStart()) / 1000
            if length > 0 and left > 0 and not select.select([self.ser.fd], [], [], left)[0]:
                return b""
            return bytes(self.ser.read(length))

    def drain(self, quiet_s: float, at_most_s: float = 0.2) -> None:
        """Throw away what comes until nothing has come for quiet_s."""
        end = time.monotonic() + at_most_s
        with gone(self.port_name):
            while time.monotonic() < end and select.select([self.ser.fd], [], [], quiet_s)[0]:
                if not os.read(self.ser.fd, 4096):
                    raise PortGone(f"{self.port_name}: closed at the other end")
            self.ser.reset_input_buffer()

    def getCurrentTime(self) -> float:
        return time.monotonic() * 1000


def wait_for(name: str, seconds: float, opened: Callable[[], None]) -> bool:
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
