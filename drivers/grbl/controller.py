"""The conversation with a Grbl controller: one line, one `ok`; real-time characters that need none.

    ?      -> <Idle|MPos:0.000,0.000,0.000|FS:0,0>      at once, whatever else goes on
    !      feed hold: brakes along the line, keeps the position
    ^X     soft reset: forgets what was to come, prints its banner; keeps the position where it stands, as after a hold
    $$     -> $130=200.000 ... ok                        settings
    $H     -> ok                                         when it is home

Grbl v1.1 Interface and Configuration (github.com/gnea/grbl/wiki); FluidNC wiki, "Serial protocol". An Arduino restarts
when its port is opened; the banner says when it listens.
"""

import re
import select
import threading
import time
from dataclasses import dataclass

import serial

from drivers.gone import PortGone, TermiosError, gone
from drivers.grbl import codes
from drivers.text_line import shown
from gonio.rig.errors import DeviceFault

TIMEOUT_S = 1.0
POKE_S = 0.25  # between two questions to one that is starting
TRIES = 3
LONGEST = 4096
HOLD, RESET, STATUS = b"!", b"\x18", b"?"
REPORT = re.compile(r"<(\w+)(?::(\d+))?\|(.*)>")
SETTING = re.compile(r"\$(\d{1,3})=([-+]?\d+(?:\.\d*)?).*")


@dataclass(frozen=True)
class Report:
    """state: Idle, Run, Hold, Alarm, Door, Home, ...; code: of Hold (0 = it stands) and Door; machine: positions."""

    state: str
    code: int | None
    machine: tuple[float, ...]


class Alarm(DeviceFault):
    """lost: whether it no longer knows where it is."""

    def __init__(self, cause: str, remedy: str, lost: bool):
        super().__init__("stage", cause, remedy)
        self.lost = lost


class Controller:
    """Methods may be called from any thread."""

    def __init__(self, port: str, baud: int, boot_s: float):
        self.port, self.baud, self.boot_s = port, baud, boot_s
        self.lock = threading.RLock()
        self.serial: serial.Serial | None = None
        self.banner = ""
        self._rest = b""
        self._heard = ""

    def open(self) -> None:
        """Open the port and wait until it listens. Raises PortGone, DeviceFault. Moves nothing."""
        self.close()
        with gone(self.port):
            self.serial = serial.Serial(self.port, self.baud, timeout=0, write_timeout=1.0, exclusive=True)
        self._rest, self._heard, self.banner = b"", "", ""
        end = time.monotonic() + self.boot_s + TIMEOUT_S
        with self.lock:
            while True:
                self.send(STATUS)
                until = time.monotonic() + POKE_S
                while (line := self._line(until)) is not None:
                    if REPORT.fullmatch(line):
                        return
                    if line.startswith(("Grbl ", "GrblHAL ")):
                        self.banner = line
                if time.monotonic() > end:
                    raise self._silent("?")

    def close(self) -> None:
        if self.serial is not None:
            try:
                self.serial.close()
            except (OSError, TermiosError):
                pass
            self.serial = None

    @property
    def is_open(self) -> bool:
        return self.serial is not None

    def send(self, data: bytes) -> None:
        """Real-time characters: not waited for, never behind a lock."""
        with gone(self.port):
            if self.serial is None:
                raise PortGone(f"{self.port}: not open")
            self.serial.write(data)

    def report(self) -> Report:
        """Where it is and what it does. Raises DeviceFault, PortGone; Alarm where it has just told one."""
        with self.lock:
            for _ in range(TRIES):
                self.send(STATUS)
                end = time.monotonic() + TIMEOUT_S
                while (line := self._line(end)) is not None:
                    self._raise_alarm(line)
                    if (found := REPORT.fullmatch(line)) is not None:
                        return _report(found, line)
            raise self._silent("?")

    def order(self, line: str, seconds: float = 0.0) -> list[str]:
        """A line, until `ok`; what it said before that. Raises DeviceFault for error:N, ALARM:N, silence; PortGone."""
        with self.lock:
            self.send(line.encode("ascii") + b"\n")
            said: list[str] = []
            end = time.monotonic() + seconds + TIMEOUT_S
            while (answer := self._line(end)) is not None:
                if answer == "ok":
                    return said
                self._raise_alarm(answer)
                if answer.startswith("error:"):
                    cause, remedy = codes.error(_number(answer))
                    raise DeviceFault("stage", f"{cause} (error {answer[6:]} to {line})", remedy)
                if not REPORT.fullmatch(answer):
                    said.append(answer)
                if len(said) > 1000:
                    break
            raise self._silent(line)

    def reset(self) -> None:
        """Soft reset; what was to come is forgotten. Raises DeviceFault, PortGone; Alarm where it was moving."""
        with self.lock:
            self.send(RESET)
            end = time.monotonic() + TIMEOUT_S
            alarm = None
            while (line := self._line(end)) is not None:
                if line.startswith(("Grbl ", "GrblHAL ")):
                    if alarm is not None:
                        raise alarm
                    return
                try:
                    self._raise_alarm(line)
                except Alarm as e:
                    alarm = e
            raise alarm or self._silent("a reset")

    def settings(self) -> dict[int, float]:
        """$$, by number."""
        found = {}
        for line in self.order("$$"):
            if (m := SETTING.fullmatch(line)) is not None:
                found[int(m[1])] = float(m[2])
        return found

    def _raise_alarm(self, line: str) -> None:
        if line.startswith("ALARM:"):
            cause, remedy, lost = codes.alarm(_number(line))
            raise Alarm(cause, remedy, lost)

    def _line(self, end: float) -> str | None:
        """The next line that is not empty; None where none is whole by `end`."""
        with gone(self.port):
            if self.serial is None:
                raise PortGone(f"{self.port}: not open")
            while True:
                line, newline, rest = self._rest.partition(b"\n")
                if newline:
                    self._rest = rest
                    text = line.decode("ascii", "backslashreplace").strip()
                    if text:
                        self._heard = text
                        return text
                    continue
                left = end - time.monotonic()
                if left <= 0 or not select.select([self.serial.fd], [], [], left)[0]:
                    return None
                self._rest = (self._rest + self.serial.read(4096))[-LONGEST:]

    def _silent(self, asked: str) -> DeviceFault:
        if not self._heard:
            return DeviceFault("stage", f"no reply to {asked}", "check its cable, supply and baud rate")
        return DeviceFault(
            "stage",
            f"no reply to {asked} that can be believed; {shown(self._heard.encode())} came last",
            "check that it runs Grbl 1.1, FluidNC or grblHAL, and its baud rate",
        )

    def gone(self, e: PortGone) -> DeviceFault:
        if e.taken:
            return DeviceFault(
                "stage", f"{self.port} is in use by another program", "stop it; one program drives a rig"
            )
        return DeviceFault("stage", f"{self.port} is gone", "plug in its USB cable, then `gonio home`")


def _report(found: re.Match[str], line: str) -> Report:
    """Raises DeviceFault where it does not tell machine positions."""
    fields = dict(part.partition(":")[::2] for part in found[3].split("|"))
    if "MPos" not in fields:
        raise DeviceFault("stage", f"reports {shown(line.encode())}, no machine position", "set $10=1")
    try:
        machine = tuple(float(x) for x in fields["MPos"].split(","))
    except ValueError:
        raise DeviceFault("stage", f"reports {shown(line.encode())}", "check its cable and baud rate") from None
    if not all(abs(x) < 1e6 for x in machine):  # NaN too
        raise DeviceFault("stage", f"reports {shown(line.encode())}", "check its cable and baud rate")
    return Report(found[1], int(found[2]) if found[2] else None, machine)


def _number(answer: str) -> int:
    text = answer.partition(":")[2].strip()
    return int(text) if text.isdecimal() and len(text) < 6 else -1
