"""Instruments that speak lines of text: `COMMAND arguments*HH` LF, answered by `text*HH` LF.

HH is the exclusive or of all bytes before the star, in hex: no damaged command is obeyed, no damaged answer believed.
Every command has one answer, which repeats the command's first word and says what was done; an error is
`ERR number,text`. Each answer is read before the next command is sent.

An Arduino restarts when its port is opened, is deaf for two seconds and then prints a banner: after every opening the
instrument is asked who it is until it answers, for `boot_s` at most. One that answers at once is not waited for.
"""

import re
import select
import threading
import time

import serial

from drivers.gone import PortGone, TermiosError, gone, wait_for
from gonio.rig.errors import DeviceFault

TRIES = 4
TIMEOUT_S = 0.1  # beyond what the instrument is known to need
GRACE_S = 5.0
BOOT_S = 3.0
QUIET_S, LOUD_S = 0.03, 0.2  # silence that is waited for before a question, and for how long at most
LONGEST = 4096  # bytes of one line
SHOWN = 40  # characters of what came, in an error
DAMAGED = -113
ERROR = re.compile(r"ERR ([-+]?\d{1,6})(?:,(.*))?")
IDENTIFY = "*IDN?"


class Refused(DeviceFault):
    """The instrument answered with an error: `code`, text."""

    def __init__(self, device: str, code: int, text: str):
        super().__init__(device, text or f"error {code}", "see its manual, then `gonio resume`")
        self.code = code


class TextLine:
    """One instrument, `device` by name; usable from any thread. restarts: how often its port was opened."""

    def __init__(self, device: str, port: str, baud: int, grace_s: float = GRACE_S, boot_s: float = BOOT_S):
        self.device, self.port, self.baud, self.grace_s, self.boot_s = device, port, baud, grace_s, boot_s
        self.lock = threading.RLock()
        self.failures = self.restarts = 0
        self.serial: serial.Serial | None = None
        self._dirty = self._booting = True
        self._heard = b""  # the last that came and was no answer

    def open(self) -> None:
        """Raises PortGone where it is not there or somebody else has it."""
        self.close()
        with gone(self.port):
            self.serial = serial.Serial(self.port, self.baud, timeout=0, write_timeout=0.5, exclusive=True)
        self._dirty = self._booting = True
        self.restarts += 1

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
        Raises Refused; DeviceFault where nothing comes, or the port is gone for longer than the grace time. Absences
        that follow each other are one longer absence.
        """
        with self.lock:
            send, tries, end = command, 0, None
            self._heard = b""
            while tries < TRIES:
                try:
                    self._await_boot()
                    answer = self._exchange(send, seconds)
                except PortGone as e:
                    end = end if end is not None else time.monotonic() + self.grace_s
                    if time.monotonic() > end or not wait_for(end - time.monotonic(), self.open):
                        raise self.gone(e) from None
                    send = again or command
                    continue
                if answer is not None and not answer.startswith("ERR"):
                    return answer.partition(" ")[2]
                if answer is not None and (error := self._error(answer)) is not None:
                    raise error
                tries += 1
                self.failures += 1
                self._dirty = True
                send = again or command
        raise self._silent()

    def _error(self, answer: str) -> Refused | None:
        """What an answer that begins with ERR means; None where the command was damaged on the way."""
        found = ERROR.fullmatch(answer)
        if found is None:
            return Refused(self.device, 0, f"answered {shown(answer.encode())}, an error without a number")
        code = int(found[1])
        return None if code == DAMAGED else Refused(self.device, code, (found[2] or "").strip())

    def _await_boot(self) -> None:
        """Ask who it is until it answers: what it is sent while it starts is lost. Raises DeviceFault, PortGone."""
        end = time.monotonic() + self.boot_s
        while self._booting:
            if self._exchange(IDENTIFY, 0.0) is not None:
                self._booting = False
            elif time.monotonic() > end:
                raise self._silent()
            else:
                self.failures += 1
                self._dirty = True

    def _silent(self) -> DeviceFault:
        if not self._heard:
            return DeviceFault(self.device, "no reply", "check its cable and supply")
        cause = f"no reply that can be believed; {shown(self._heard)} came instead"
        return DeviceFault(self.device, cause, "check its firmware, baud rate, and that it sends nothing unasked")

    def gone(self, e: PortGone) -> DeviceFault:
        if e.taken:
            return DeviceFault(
                self.device, f"{self.port} is in use by another program", "stop it; one program drives a rig"
            )
        return DeviceFault(self.device, f"{self.port} is gone", "plug in its USB cable, then `gonio resume`")

    def _exchange(self, command: str, seconds: float) -> str | None:
        """The first undamaged answer to `command`, or an error; None where none comes in time."""
        s = self.serial
        with gone(self.port):
            if s is None:
                raise PortGone(f"{self.port}: not open")
            if self._dirty:
                self._drain(s)
            self._dirty = True  # until the answer is whole
            s.reset_input_buffer()
            s.write(command.encode() + b"*%02X\n" % checksum(command.encode()))
            end = time.monotonic() + seconds + TIMEOUT_S
            rest = b""
            while True:
                left = end - time.monotonic()
                if left <= 0 or not select.select([s.fd], [], [], left)[0]:
                    return None
                *lines, rest = (rest + s.read(4096)).split(b"\n")
                for line in lines:
                    text = undamaged(line)
                    if text is not None and text.partition(" ")[0] in (command.partition(" ")[0], "ERR"):
                        self._dirty = bool(rest)
                        return text
                    self._heard = line or self._heard
                if len(rest) > LONGEST:
                    self._heard = rest
                    return None

    def _drain(self, s: serial.Serial) -> None:
        """Read away whatever was late, until it is silent; one that never is is not waited for."""
        end = time.monotonic() + LOUD_S
        while select.select([s.fd], [], [], QUIET_S)[0] and time.monotonic() < end:
            self._heard = s.read(4096).strip() or self._heard


def undamaged(line: bytes) -> str | None:
    """The text of `text*HH` LF, None where the sum is wrong or it is not ASCII."""
    text, star, total = line.strip().rpartition(b"*")
    good = star and re.fullmatch(rb"[0-9A-Fa-f]{2}", total) and int(total, 16) == checksum(text)
    return text.decode("ascii") if good and text.isascii() else None


def checksum(text: bytes) -> int:
    total = 0
    for byte in text:
        total ^= byte
    return total


def shown(data: bytes) -> str:
    """What came, in quotes, cut short."""
    text = data.decode("ascii", "backslashreplace").strip()
    return repr(text[:SHOWN] + ("…" if len(text) > SHOWN else ""))
