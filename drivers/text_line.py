"""Instruments that speak lines of text: `COMMAND arguments*HH` LF, answered by `text*HH` LF.

HH is the exclusive or of all bytes before the star, in hex: no damaged command is obeyed, no damaged answer believed.
Every command has one answer, which repeats the command's first word and says what was done; an error is
`ERR number,text`. Each answer is read before the next command is sent.
"""

import select
import threading
import time

import serial

from drivers.gone import PortGone, TermiosError, gone, wait_for
from gonio.rig.errors import DeviceFault

TRIES = 4
TIMEOUT_S = 0.1  # beyond what the instrument is known to need
GRACE_S = 5.0


class Refused(Exception):
    """The instrument answered with an error: `code`, text."""

    def __init__(self, code: int, text: str):
        super().__init__(text)
        self.code = code


class TextLine:
    """One instrument, `device` by name; usable from any thread."""

    def __init__(self, device: str, port: str, baud: int, grace_s: float = GRACE_S):
        self.device, self.port, self.baud, self.grace_s = device, port, baud, grace_s
        self.lock = threading.RLock()
        self.failures = 0
        self.serial: serial.Serial | None = None
        self._dirty = True

    def open(self) -> None:
        """Raises PortGone where it is not there or somebody else has it."""
        self.close()
        with gone(self.port):
            self.serial = serial.Serial(self.port, self.baud, timeout=0, write_timeout=0.5, exclusive=True)
        self._dirty = True

    def close(self) -> None:
        if self.serial is not None:
            try:
                self.serial.close()
            except (OSError, TermiosError):
                pass
            self.serial = None

    def ask(self, command: str, seconds: float = 0.0, *, again: str | None = None) -> str:
        """The answer without its first word; seconds: what the instrument needs for it.

        again: what to send instead where the answer was lost (a command that must not be carried out twice).
        Raises Refused; DeviceFault where nothing comes, or the port is gone for longer than the grace time.
        """
        with self.lock:
            send = command
            for _ in range(TRIES):
                try:
                    answer = self._exchange(send, seconds)
                except PortGone as e:
                    if not wait_for(self.grace_s, self.open):
                        raise self.gone(e) from None
                    answer = None
                if answer is not None:
                    word, _, rest = answer.partition(" ")
                    if word == "ERR":
                        code, _, text = rest.partition(",")
                        if int(code) != -113:  # -113: damaged on the way
                            raise Refused(int(code), text)
                    elif word == send.partition(" ")[0]:
                        return rest
                self.failures += 1
                self._dirty = True
                send = again or command
        raise DeviceFault(self.device, "no reply", "check its cable and supply")

    def gone(self, e: PortGone) -> DeviceFault:
        if e.taken:
            return DeviceFault(
                self.device, f"{self.port} is in use by another program", "stop it; one program drives a rig"
            )
        return DeviceFault(self.device, f"{self.port} is gone", "plug in its USB cable, then `gonio resume`")

    def _exchange(self, command: str, seconds: float) -> str | None:
        """The undamaged text of the next line; None where none comes in time."""
        s = self.serial
        with gone(self.port):
            if s is None:
                raise PortGone(f"{self.port}: not open")
            if self._dirty:
                while select.select([s.fd], [], [], 0.03)[0]:  # whatever was late
                    s.read(4096)
            self._dirty = True  # until the answer is whole
            s.reset_input_buffer()
            s.write(command.encode() + b"*%02X\n" % checksum(command.encode()))
            end = time.monotonic() + seconds + TIMEOUT_S
            line = b""
            while not line.endswith(b"\n"):
                left = end - time.monotonic()
                if left <= 0 or not select.select([s.fd], [], [], left)[0]:
                    return None
                line += s.read(4096)
        self._dirty = False
        return undamaged(line)


def undamaged(line: bytes) -> str | None:
    """The text of `text*HH` LF, None where the sum is wrong."""
    text, star, total = line.strip().rpartition(b"*")
    try:
        good = star and int(total, 16) == checksum(text)
    except ValueError:
        return None
    return text.decode("ascii", "replace") if good else None


def checksum(text: bytes) -> int:
    total = 0
    for byte in text:
        total ^= byte
    return total
