"""The far end of a text line: cuts bytes into commands, checks and makes the sums."""

from collections.abc import Callable

UNKNOWN = "ERR -113,undefined header"


class TextDevice:
    """Implements `sim.wire.line.Device`. commands: first word -> function of the arguments that gives the answer."""

    def __init__(self, commands: dict[str, Callable[[str], str]]):
        self.commands = commands
        self.busy_s = 0.0
        self.silent = False
        self._buffer = b""

    def receive(self, data: bytes) -> list[bytes]:
        self.busy_s = 0.0
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        answers = [self._obey(line) for line in lines]
        return [] if self.silent else [answer.encode() + b"*%02X\n" % _sum(answer.encode()) for answer in answers]

    def _obey(self, line: bytes) -> str:
        text, _, total = line.rpartition(b"*")
        if total != b"%02X" % _sum(text):
            return UNKNOWN
        word, _, arguments = text.decode("ascii", "replace").partition(" ")
        command = self.commands.get(word)
        if command is None:
            return UNKNOWN
        try:
            answer = command(arguments)
        except ValueError:
            return UNKNOWN
        return answer if answer.startswith("ERR") else f"{word} {answer}".rstrip()


def _sum(text: bytes) -> int:
    total = 0
    for byte in text:
        total ^= byte
    return total
