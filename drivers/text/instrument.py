"""The conversation with an instrument that speaks text: opening, starting, commands, questions, errors.

An Arduino restarts when its port is opened, is deaf for two seconds and then prints a banner: what comes before the
first good answer is read away, for `boot_s` at most. One that answers at once is not waited for. An echo of what was
sent, a prompt and empty lines are passed over; every other line is an answer, or is shown in an error.
"""

import re
import time
from typing import NoReturn

from drivers.gone import PortGone
from drivers.text.answers import Answer, Answers
from drivers.text.port import TextPort
from drivers.text_line import shown
from gonio.config.instrument import Question, TextSection
from gonio.rig.errors import DeviceFault

TRIES = 3
POKE_S = 0.3  # between two questions to one that is starting
MOST_ERRORS = 8  # of one queue, that are read away at the start
DESCRIPTION = "check its description and its manual"


class TextInstrument:
    """One instrument on its port. `open` it first. sessions: how often that was done; its settings are gone then."""

    def __init__(self, section: TextSection):
        self.i = section.instrument
        self.name = self.i.name
        self.port = TextPort(section.port, self.i.serial, section.baud)
        self.boot_s = self.i.boot_s if section.boot_s is None else section.boot_s
        self.answers = Answers(self.i)
        self.sessions = 0
        self.identity = ""
        self._dirty = True
        self._ignore, self._refused, self._acknowledged = (
            re.compile(p) if p else None for p in (self.i.ignore, self.i.refused, self.i.acknowledged)
        )

    def open(self) -> None:
        """Open the port, wait until it listens, and send its `init`. Raises PortGone, DeviceFault."""
        self.port.open()
        self.sessions += 1
        self._dirty = True
        self._await_start()
        self._forget_errors()
        for command in self.i.init:
            self.order(command)

    def close(self) -> None:
        self.port.close()

    # ---- what is said ----------------------------------------------------------------------------------------------

    def order(self, command: str) -> None:
        """A command that asks nothing. Raises DeviceFault where the instrument refuses it; PortGone."""
        if self._acknowledged is not None:
            self._ask(command, self._acknowledged, 0.0, "acknowledgement")
        else:
            self._send(command)
        if (e := self.i.errors) is not None:
            self._raise_error(command, self._ask(e.ask, re.compile(e.answer), 0.0, "errors"))

    def read(self, seconds: float = 0.0) -> Answer:
        """One reading, of `seconds` of integration. Raises DeviceFault, PortGone."""
        why: ValueError | None = None
        text = ""
        for _ in range(TRIES):
            line = self._line_of(self.i.query, seconds + self.i.reading_s)
            if line is None:
                continue
            try:
                return self.answers.read(line)
            except ValueError as e:
                why, text = e, line
                self._dirty = True
        if why is None:
            self._silent(self.i.query)
        asked = f" to {self.i.query}" if self.i.query else ""
        raise DeviceFault(self.name, f"answered {shown(text.encode())}{asked}: {why}", DESCRIPTION)

    # ---- starting --------------------------------------------------------------------------------------------------

    def _await_start(self) -> None:
        """Until it has said what it should. Raises DeviceFault, PortGone."""
        first, begun, said = self._first(), time.monotonic(), None
        end = begun + self.boot_s + self.i.timeout_s
        if self.i.banner is not None and self.boot_s > 0:
            self._await_banner(begun + self.boot_s)
        while True:
            if self.boot_s == 0 or time.monotonic() > begun + self.boot_s:
                wait = self.i.timeout_s + (self.i.reading_s if first.ask == self.i.query else 0.0)
            else:
                wait = POKE_S
            if first.ask:
                self._send(first.ask)
            until = time.monotonic() + wait
            while (line := self._next(first.ask, until)) is not None:
                if re.fullmatch(first.answer, line) or (first.ask == self.i.query and self._is_reading(line)):
                    self.identity = line
                    self._dirty = True  # an answer to an earlier question may still be on its way
                    return
                said = line
            if time.monotonic() >= end:
                if said is None:
                    self._silent(first.ask)
                self._misunderstood(first, said)

    def _misunderstood(self, first: Question, said: str) -> NoReturn:
        """It answers, and never as it should."""
        asked = f" to {first.ask}" if first.ask else ""
        if self.i.identify is None:
            try:
                self.answers.read(said)
            except ValueError as e:
                raise DeviceFault(self.name, f"answered {shown(said.encode())}{asked}: {e}", DESCRIPTION) from None
        raise DeviceFault(
            self.name, f"says {shown(said.encode())}{asked} on {self.port.port}", f"check its port; else {DESCRIPTION}"
        )

    def _first(self) -> Question:
        """What it is asked at first: who it is, or a reading."""
        if self.i.identify is not None:
            return self.i.identify
        return Question.model_construct(ask=self.i.query, answer=self.i.answer)

    def _is_reading(self, line: str) -> bool:
        try:
            self.answers.read(line)
        except ValueError:
            return False
        return True

    def _await_banner(self, end: float) -> None:
        """One that was not restarted prints none: it is asked all the same."""
        pattern = re.compile(self.i.banner or "")
        while (line := self._next("", end)) is not None:
            if pattern.search(line):
                return

    def _forget_errors(self) -> None:
        """Of whoever used it before."""
        e = self.i.errors
        for _ in range(MOST_ERRORS if e else 0):
            assert e is not None
            line = self._ask(e.ask, re.compile(e.answer), 0.0, "errors")
            if _code(e.answer, line) == _plain(e.none):
                return

    def _raise_error(self, command: str, line: str) -> None:
        e = self.i.errors
        assert e is not None
        if _code(e.answer, line) != _plain(e.none):
            raise DeviceFault(self.name, f"answered {shown(line.encode())} to {command}", DESCRIPTION)

    # ---- lines -----------------------------------------------------------------------------------------------------

    def _ask(self, command: str, pattern: re.Pattern[str], seconds: float, what: str) -> str:
        """The answer to a command, which has to match. Raises DeviceFault, PortGone."""
        line = None
        for _ in range(TRIES):
            line = self._line_of(command, seconds)
            if line is not None and pattern.fullmatch(line):
                return line
            self._dirty = True
        if line is None:
            self._silent(command)
        raise DeviceFault(
            self.name, f"answered {shown(line.encode())} to {command}, which `{what}` does not match", DESCRIPTION
        )

    def _line_of(self, command: str, seconds: float) -> str | None:
        """What comes after a command, None where nothing does in time. Raises DeviceFault for a refusal; PortGone."""
        if command:
            # what came unasked may be the half of an answer: its other half must not be taken for one
            if self.port.clear() or self.port.begun.strip() not in (b"", self.i.prompt.strip().encode()) or self._dirty:
                self.port.drain()
            self._dirty = True  # until the answer is here
            self._send(command)
        else:
            self._skip_begun(seconds)
        line = self._next(command, time.monotonic() + seconds + self.i.timeout_s)
        self._dirty = line is None
        if line is not None and self._refused and self._refused.search(line):
            asked = f" to {command}" if command else ""
            raise DeviceFault(self.name, f"answered {shown(line.encode())}{asked}", DESCRIPTION)
        return line

    def _skip_begun(self, seconds: float) -> None:
        """Of one that sends by itself: what lies there is of the past, and so is the line that has begun."""
        self.port.clear()
        if self.port.begun or self._dirty:
            self.port.line(time.monotonic() + seconds + self.i.timeout_s)

    def _next(self, command: str, end: float) -> str | None:
        """The next line that is neither an echo of `command`, nor a prompt, nor to be ignored."""
        while (raw := self.port.line(end)) is not None:
            line = _decoded(raw).strip().lstrip("\0")
            while self.i.prompt and line.startswith(self.i.prompt.strip()) and self.i.prompt.strip():
                line = line.removeprefix(self.i.prompt.strip()).lstrip()
            if not line or (command and line == command.strip()) or (self._ignore and self._ignore.search(line)):
                continue
            return line
        return None

    def _send(self, command: str) -> None:
        self.port.send((command + self.i.line_end).encode("ascii"))

    def _silent(self, command: str) -> NoReturn:
        heard = self.port.heard.strip()
        asked = f" to {command}" if command else ""
        if not heard:
            raise DeviceFault(self.name, f"no reply{asked}", "check its cable, supply, baud rate and line_end")
        raise DeviceFault(self.name, f"no reply{asked}; {shown(heard)} came before", DESCRIPTION)

    def gone(self, e: PortGone) -> DeviceFault:
        """What to tell of a port that is away."""
        if e.taken:
            return DeviceFault(
                self.name, f"{self.port.port} is in use by another program", "stop it; one program drives a rig"
            )
        remedy = "check the network" if self.port.port.startswith("tcp://") else "plug in its USB cable"
        return DeviceFault(self.name, f"{self.port.port} is gone", f"{remedy}, then `gonio resume`")


def _decoded(raw: bytes) -> str:
    """UTF-8, or Latin-1: a micro sign comes in either."""
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _code(pattern: str, line: str) -> str:
    found = re.compile(pattern).fullmatch(line)
    return _plain(found["code"]) if found else ""


def _plain(code: str) -> str:
    """+0 and 0 are one code."""
    return code.strip().lstrip("+")
