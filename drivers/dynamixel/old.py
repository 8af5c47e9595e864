"""Servos that speak protocol 1.0 (AX, RX, DX, EX, and MX as they are sold): found and named, not driven.

They have no Bus Watchdog, no profiles in time and no sync read: what keeps an arm safe here is not in them.
emanual.robotis.com/docs/en/dxl/protocol1; model numbers: "Model Number" of each servo's page there.
"""

from dynamixel_sdk import COMM_SUCCESS, Protocol1PacketHandler

from drivers.dynamixel.bus import QUIET_S, Bus
from gonio.rig.errors import DeviceFault

MODELS = {
    12: "AX-12A", 18: "AX-18A", 300: "AX-12W", 10: "RX-10", 24: "RX-24F", 28: "RX-28", 64: "RX-64", 107: "EX-106",
    113: "DX-113", 116: "DX-116", 117: "DX-117", 360: "MX-12W", 29: "MX-28", 310: "MX-64", 320: "MX-106",
}  # fmt: skip
REMEDY = "take one of protocol 2.0, such as an X series; an MX can be given firmware for it by the maker's tool"


def found(bus: Bus, servo: int) -> str | None:
    """The model of a servo that answers protocol 1.0; None where none does. To be asked where 2.0 got no answer."""
    with bus.lock:
        bus.port.drain(QUIET_S)
        bus.port.is_using = False
        try:
            number, result, _ = Protocol1PacketHandler().ping(bus.port, servo)
        except IndexError:  # the SDK on half an answer
            return None
        finally:
            bus.port.is_using = False
            bus.port.drain(QUIET_S)
    return MODELS.get(number, f"model {number}") if result == COMM_SUCCESS else None


def refusal(name: str, servo: int, model: str) -> DeviceFault:
    return DeviceFault(name, f"servo {servo} is an {model}, which speaks protocol 1.0 and cannot be driven", REMEDY)
