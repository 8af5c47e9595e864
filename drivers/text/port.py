"""A serial port or a TCP connection that carries lines of text: LF, CR or both end a line."""

import re
import select
import socket
import time
from typing import Protocol

import serial

from drivers.gone import PortGone, TermiosError, gone
from gonio.config.instrument import SerialLine

LONGEST = 65_536  # bytes of one line: 2,048 numbers and their separators
ENDS = re.compile(rb"[\r\n]+")
CONNECT_S = 3.0
QUIET_S, LOUD_S = 0.03, 0.3  # silence that ends a draining, and how long one may take
PARITY = {"none": serial.PARITY_NONE, "even": serial.PARITY_EVEN, "odd": serial.PARITY_ODD}


class Carrier(Protocol):
    """What a port and a socket have in common; all of it may raise OSError."""

    def fileno(self) -> int: ...

    def send(self, data: bytes) -> None: ...

    def receive(self) -> bytes:
        """What is there; b"" = the other end has gone."""
        ...

    def close(self) -> None: ...


class SerialCarrier:
    def __init__(self, port: str, line: SerialLine, baud: int | None):
        self.serial = serial.Serial(
            port,
            baud or line.baud,
            bytesize=line.bits,
            parity=PARITY[line.parity],
            stopbits=line.stop_bits,
            xonxoff=line.flow == "xon",
            rtscts=line.flow == "rts",
            timeout=0,
            write_timeout=1.0,
            exclusive=True,
        )

    def fileno(self) -> int:
        return int(self.serial.fileno())

    def send(self, data: bytes) -> None:
        self.serial.write(data)

    def receive(self) -> bytes:
        return bytes(self.serial.read(4096))

    def close(self) -> None:
        self.serial.close()


class TcpCarrier:
    def __init__(self, address: str):
        host, _, port = address.removeprefix("tcp://").rpartition(":")
        self.socket = socket.create_connection((host.strip("[]"), int(port)), CONNECT_S)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def fileno(self) -> int:
        return self.socket.fileno()

    def send(self, data: bytes) -> None:
        self.socket.sendall(data)

    def receive(self) -> bytes:
        return self.socket.recv(4096)

    def close(self) -> None:
        self.socket.close()


class TextPort:
    """`open` it first. Whatever the port does by going away is PortGone."""

    def __init__(self, port: str, line: SerialLine, baud: int | None = None):
        self.port, self.line_settings, self.baud = port, line, baud
        self._carrier: Carrier | None = None
        self._rest = b""
        self._lines: list[bytes] = []
        self.heard = b""  # the last that came

    def open(self) -> None:
        """Raises PortGone where it is not there or somebody else has it."""
        self.close()
        with gone(self.port):
            if self.port.startswith("tcp://"):
                self._carrier = TcpCarrier(self.port)
            else:
                self._carrier = SerialCarrier(self.port, self.line_settings, self.baud)

    def close(self) -> None:
        carrier, self._carrier = self._carrier, None
        self._rest, self._lines, self.heard = b"", [], b""
        if carrier is not None:
            try:
                carrier.close()
            except (OSError, TermiosError):
                pass

    def send(self, data: bytes) -> None:
        with gone(self.port):
            if self._carrier is None:
                raise PortGone(f"{self.port}: not open")
            self._carrier.send(data)

    def line(self, end: float) -> bytes | None:
        """The next line that is not empty, without its end; None where none is whole by `end`, on the machine's clock.

        A line longer than LONGEST is given as it is by then.
        """
        while not self._lines:
            if len(self._rest) > LONGEST:
                line, self._rest = self._rest, b""
                return line
            if not self._more(max(end - time.monotonic(), 0.0)):
                return None
        return self._lines.pop(0)

    def drain(self) -> None:
        """Read away whatever is there or on its way, until it is silent; one that never is is not waited for."""
        end = time.monotonic() + LOUD_S
        while self._more(QUIET_S) and time.monotonic() < end:
            pass
        self._lines, self._rest = [], b""

    def clear(self) -> bool:
        """Forget the lines that are there already; nothing is waited for, and the beginning of a line that is still
        coming stays. Whether there were any lines."""
        end = time.monotonic() + LOUD_S
        while self._more(0.0) and time.monotonic() < end:
            pass
        found, self._lines = bool(self._lines), []
        return found

    @property
    def begun(self) -> bytes:
        """A line that has begun and not ended; a prompt looks like one."""
        return self._rest

    def _more(self, seconds: float) -> bool:
        """Wait for bytes; whether any came."""
        with gone(self.port):
            if self._carrier is None:
                raise PortGone(f"{self.port}: not open")
            if not select.select([self._carrier.fileno()], [], [], seconds)[0]:
                return False
            data = self._carrier.receive()
            if not data:
                raise PortGone(f"{self.port}: closed by the other end")
        *lines, self._rest = ENDS.split(self._rest + data)
        self._lines += [line for line in lines if line.strip()]
        self.heard = (self._lines[-1] if self._lines else self._rest or self.heard)[-200:]
        return True
