"""What is connected to the ports: which of them leads to servos, to a photodiode, to a lamp. Moves nothing.

Each port is asked who it is as an instrument first (one that restarts when it is opened is waited for), then as a bus
of Dynamixel servos at the two rates that they are delivered with and used at.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path

from drivers.dynamixel import tables as t
from drivers.dynamixel.bus import Bus
from drivers.gone import PortGone
from drivers.text_line import TextLine
from gonio.rig.errors import DeviceFault

TEXT_BAUD = 115200
SERVO_BAUDS = 1_000_000, 57_600
BOOT_S = 3.0
MODEL_NAMES = {number: name for name, number in t.MODELS.items()}


@dataclass
class Found:
    """Ports by what answers there; servos id -> model number. None, {} where nothing does."""

    stage: str | None = None
    stage_baud: int = SERVO_BAUDS[0]
    servos: dict[int, int] = field(default_factory=dict)
    photodiode: str | None = None
    light: str | None = None
    lines: list[str] = field(default_factory=list)  # what is to be said of each port

    @property
    def model(self) -> str | None:
        """The servos' common model by name; None where they are of several, or of one that is not known."""
        numbers = set(self.servos.values())
        return MODEL_NAMES.get(numbers.pop()) if len(numbers) == 1 else None


def ports_by_id() -> list[str]:
    """The stable names of the serial ports that are plugged in."""
    return [str(p) for p in sorted(Path("/dev/serial/by-id").glob("*"))]


def find(ports: Iterable[str], say: Callable[[str], None] = lambda line: None, boot_s: float = BOOT_S) -> Found:
    """Ask each port; the first of each kind counts. What a port does wrong is a line, never an exception."""
    found = Found()
    for port in ports:
        try:
            line = _instrument(port, found, boot_s) or _servos(port, found) or "nobody that is known answers"
        except (PortGone, DeviceFault) as e:
            line = str(e)
        found.lines.append(line if port in line else f"{port}: {line}")
        say(found.lines[-1])
    return found


def _instrument(port: str, found: Found, boot_s: float) -> str | None:
    line = TextLine("instrument", port, TEXT_BAUD, grace_s=0, boot_s=boot_s)
    line.open()
    try:
        identity = line.ask("*IDN?").split(",")
    except DeviceFault:
        return None
    finally:
        line.close()
    who = " ".join(identity[:2])[:60]
    if len(identity) == 5:
        found.photodiode = found.photodiode or port
        return f"photodiode {who}, {identity[4][:4]} channels"
    if len(identity) == 4:
        found.light = found.light or port
        return f"light {who}"
    return f"an instrument that is neither photodiode nor light: {who}"


def _servos(port: str, found: Found) -> str | None:
    for baud in SERVO_BAUDS:
        bus = Bus(port, baud, {})
        bus.open()
        try:
            there, _ = bus.packets.broadcastPing(bus.port)
        finally:
            bus.close()
        if there:
            servos = {int(i): int(seen[0]) for i, seen in sorted(there.items())}
            if found.stage is None:
                found.stage, found.stage_baud, found.servos = port, baud, servos
            who = ", ".join(f"id {i} {MODEL_NAMES.get(n, f'model {n}')}" for i, n in servos.items())
            return f"servos at {baud} baud: {who}"
    return None
