"""The far end of a text line: cuts bytes into commands, checks and makes the sums."""

from collections.abc import Callable

DEAF_PACKETS = 15  # two seconds of a driver that asks again every 0.13 s
UNKNOWN = "ERR -113,undefined header"


class TextDevice:
    """Implements `sim.wire.line.Device`. commands: first word -> function of the arguments that gives the answer."""

    def __init__(self, commands: dict[str, Callable[[str], str]]):
        self.commands = commands
        self.busy_s = 0.0
        self.silent = False
        self.boots = False  # an Arduino: deaf after its port was opened, until so many packets were lost, then a banner
        self.deaf_to = 0
        self.altered: Callable[[str], str] = lambda answer: answer  # what a bad firmware makes of an answer
        self._buffer = b""

    def restarted(self) -> None:
        if self.boots:
            self.deaf_to = DEAF_PACKETS
            self.power_on()

    def power_on(self) -> None:
        """All that was set is forgotten."""

    def receive(self, data: bytes) -> list[bytes]:
        self.busy_s = 0.0
        if self.deaf_to > 0:
            self.deaf_to -= 1
            self._buffer = b""
            return [b"boot ok\r\n"] if self.deaf_to == 0 else []
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        answers = [self._obey(line) for line in lines]
        altered = [self.altered(answer).encode() for answer in answers]
        return [] if self.silent else [answer + b"*%02X\n" % _sum(answer) for answer in altered]

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
