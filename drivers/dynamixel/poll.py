"""What one sync read says of a servo: all of `tables.POLL`, decoded."""

import struct
from typing import NamedTuple

# bytes 70 hardware error, 98 watchdog, 116 goal, 122 moving, 132 position, 144 voltage, 146 temperature
LAYOUT = struct.Struct("<B27xB17xi2xB9xi8xHB")


class State(NamedTuple):
    """In the servo's own units. `hardware` is register 70, or 0x80 where only the alert bit was seen."""

    hardware: int
    watchdog: int
    goal: int
    moving: bool
    position: int
    volts: float
    celsius: int


def decode(data: bytes, error: int) -> State:
    """data: the bytes of tables.POLL; error: the status packet's error byte."""
    hardware, watchdog, goal, moving, position, volts, celsius = LAYOUT.unpack(data)
    return State(hardware or error & 0x80, watchdog, goal, bool(moving), position, volts / 10, celsius)
