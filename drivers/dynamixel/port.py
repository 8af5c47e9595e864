"""The serial port under dynamixel-sdk: opened for one owner only, waiting without burning the processor.

Whatever the kernel says when the adapter is unplugged (OSError, SerialException, termios.error, select on a closed
file) becomes PortGone.
"""

import os
import select
import time
from typing import Any

import serial
from dynamixel_sdk import PortHandler

from drivers.gone import PortGone, TermiosError, gone

BAUDS = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000)


class Port(PortHandler):
    """A PortHandler on the monotonic clock. Only whoever holds the bus's lock may use it."""

    def __init__(self, name: str, baud: int):
        super().__init__(name)
        self.baudrate = baud
        self._buffer = b""

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
        self._buffer = b""
        with gone(self.port_name):
            self.ser.reset_input_buffer()

    def writePort(self, packet: Any) -> int:
        with gone(self.port_name):
            return int(self.ser.write(bytes(packet)))

    def readPort(self, length: int) -> bytes:
        """What has come, at most `length` bytes; waits for the first of it until the packet's deadline."""
        if not self._buffer:
            left = (self.packet_timeout - self.getTimeSinceStart()) / 1000
            with gone(self.port_name):
                if not select.select([self.ser.fd], [], [], max(left, 0.0))[0]:
                    return b""
                self._buffer = self._read()
        data, self._buffer = self._buffer[:length], self._buffer[length:]
        return data

    def _read(self) -> bytes:
        data = os.read(self.ser.fd, 4096)
        if not data:
            raise PortGone(f"{self.port_name}: closed at the other end")
        return data

    def drain(self, quiet_s: float, at_most_s: float = 0.2) -> None:
        """Throw away what comes until nothing has come for quiet_s."""
        end = time.monotonic() + at_most_s
        with gone(self.port_name):
            while time.monotonic() < end and select.select([self.ser.fd], [], [], quiet_s)[0]:
                self._read()
        self.clearPort()

    @property
    def timed_out(self) -> bool:
        """Whether the last packet was waited for in vain."""
        return self.packet_timeout == 0

    def getCurrentTime(self) -> float:
        return time.monotonic() * 1000
