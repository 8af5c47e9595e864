"""The far end of a line of plain text: a table of commands, and how an instrument behaves besides."""

import re
from collections.abc import Callable, Sequence

Row = tuple[str, Callable[..., str | None]]


class PlainDevice:
    """Implements `sim.wire.line.Device`. rows: pattern of a whole command -> function of its groups that gives the
    answer, None = nothing is said. Ends of lines are what the host sends; answers end with `end`."""

    def __init__(self, rows: Sequence[Row], *, end: str = "\n", unknown: str | None = None):
        self.rows = [(re.compile(pattern), act) for pattern, act in rows]
        self.end, self.unknown = end, unknown
        self.busy_s = 0.0
        self.echo, self.prompt, self.silent = False, "", False
        self.banner: str | None = None
        self.deaf_to = 0  # packets that are lost while it starts
        self.altered: Callable[[str], str] = lambda answer: answer  # what it says in place of its answer
        self.commands: list[str] = []
        self._buffer = ""

    def restarted(self) -> None:
        """Its port was opened anew."""

    def receive(self, data: bytes) -> list[bytes]:
        self.busy_s = 0.0
        if self.deaf_to > 0:
            self.deaf_to -= 1
            self._buffer = ""
            return [f"{self.banner}{self.end}".encode()] if self.deaf_to == 0 and self.banner is not None else []
        *lines, self._buffer = re.split("\r\n|\r|\n", self._buffer + data.decode("utf-8", "replace"))
        out = ""
        for line in filter(None, lines):
            answer = self._obey(line)
            out += f"{line}{self.end}" if self.echo else ""
            out += "" if answer is None else f"{self.altered(answer)}{self.end}"
            out += self.prompt
        return [] if self.silent or not out else [out.encode()]

    def _obey(self, line: str) -> str | None:
        self.commands.append(line)
        for pattern, act in self.rows:
            if (found := pattern.fullmatch(line)) is not None:
                return act(*found.groups())
        return self.unknown
