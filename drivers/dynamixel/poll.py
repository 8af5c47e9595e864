"""What one sync read says of a servo: all of `tables.POLL`, decoded."""

from dataclasses import dataclass

from drivers.dynamixel import tables as t


@dataclass(frozen=True)
class State:
    """In the servo's own units. `hardware` is register 70, or a non-zero guess where only the alert bit was seen."""

    hardware: int
    watchdog: int
    goal: int
    moving: bool
    position: int
    volts: float
    celsius: int


def decode(data: bytes, error: int) -> State:
    """data: the bytes of tables.POLL; error: the status packet's error byte."""
    hardware = data[0]
    return State(
        hardware=hardware or (0x80 if error & 0x80 else 0),
        watchdog=data[t.WATCHDOG.address - 70],
        goal=_number(data, t.GOAL),
        moving=bool(data[t.MOVING.address - 70]),
        position=_number(data, t.PRESENT_POSITION),
        volts=_number(data, t.VOLTAGE) / 10,
        celsius=data[t.TEMPERATURE.address - 70],
    )


def _number(data: bytes, register: t.Register) -> int:
    at = register.address - t.POLL.address
    return int.from_bytes(data[at : at + register.size], "little", signed=register.signed)
