"""Registers of Dynamixel X-series servos as data.

XM430: emanual.robotis.com/docs/en/dxl/x/xm430-w350 (and -w210), XL430: .../x/xl430-w250, XH430: .../x/xh430-w350,
XL330: .../x/xl330-m288 (-m077), XC330: .../x/xc330-m288 (-m181, -t181, -t288), XC430: .../x/xc430-w240 (-w150), XM540:
.../x/xm540-w270 (-w150); section "Control Table of EEPROM Area" and "... of RAM Area" of each. Addresses and units are
common to all of them; supply and temperature limits are read from each servo.
"""

from typing import NamedTuple


class Register(NamedTuple):
    """address, bytes, and whether the number is signed. Below 64: EEPROM, writable with the torque off only."""

    address: int
    size: int
    signed: bool = False


MODEL = Register(0, 2)
FIRMWARE = Register(6, 1)
RETURN_DELAY = Register(9, 1)  # 2 us units
DRIVE_MODE = Register(10, 1)
OPERATING_MODE = Register(11, 1)
HOMING_OFFSET = Register(20, 4, True)
TEMPERATURE_LIMIT = Register(31, 1)
MAX_VOLTAGE = Register(32, 2)  # 0.1 V
MIN_VOLTAGE = Register(34, 2)
VELOCITY_LIMIT = Register(44, 4)
MAX_POSITION = Register(48, 4)
MIN_POSITION = Register(52, 4)
SHUTDOWN = Register(63, 1)
TORQUE = Register(64, 1)
STATUS_RETURN = Register(68, 1)
HARDWARE_ERROR = Register(70, 1)
POSITION_I_GAIN = Register(82, 2)
WATCHDOG = Register(98, 1)  # 20 ms units, reads TRIPPED after a trip
PROFILE_ACCELERATION = Register(108, 4)  # time-based: ms of each ramp, at most half of all
PROFILE_VELOCITY = Register(112, 4)  # time-based: ms of the whole move; 0 = as fast as it can
GOAL = Register(116, 4, True)
MOVING = Register(122, 1)
PRESENT_VELOCITY = Register(128, 4, True)
PRESENT_POSITION = Register(132, 4, True)
VOLTAGE = Register(144, 2)
TEMPERATURE = Register(146, 1)

POLL = Register(70, 77)  # hardware error ... temperature: all that a poll looks at, in one read
MOVE = Register(108, 12)  # ramp, time, goal: all that starts a move, in one write

TRIPPED = 255
POSITION_MODE = 3
COUNTS = 4096  # per turn
ZERO = 2048  # where a joint stands at 0
VELOCITY_UNIT_DEG_S = 1.374
# Profiles say how long a move takes, in ms, not how fast it is. Speeds come in steps of 1.374 deg/s, accelerations in
# steps of 21.46 deg/s^2: too coarse for axes to keep to a straight line, and off that line lies the stay-out cone.
TIME_BASED = 0b100
GENTLE_MS = 2000, 8000  # ramp and time of a move that nobody planned
WATCHDOG_UNIT_S = 0.02
I_GAIN = 100  # the default of 0 lets a loaded servo rest some counts short of its goal
SHUTDOWN_MASK = 0b110100  # overheat, shock, overload; voltage is told but does not let the arms fall

MODELS = {
    "XM430-W350": 1020, "XM430-W210": 1030, "XL430-W250": 1060, "XH430-W350": 1000,
    "XL330-M077": 1190, "XL330-M288": 1200,
    "XC330-M181": 1230, "XC330-M288": 1240, "XC330-T181": 1210, "XC330-T288": 1220,
    "XC430-W150": 1070, "XC430-W240": 1080,
    "XM540-W150": 1130, "XM540-W270": 1120,
}  # fmt: skip

# bit of HARDWARE_ERROR -> what it means, what to do
HARDWARE_ERRORS = {
    0: ("supply voltage out of range", "check the supply and its plugs"),
    2: ("overheated", "let it cool down and look for what makes it work so hard"),
    3: ("motor encoder failed", "replace the servo"),
    4: ("electrical shock or too little power", "check supply and cables"),
    5: ("overload", "free the joint, look for a collision or too heavy an arm"),
}
# low bits of a status packet's error byte
STATUS_ERRORS = {
    1: "could not process the instruction",
    2: "does not know the instruction",
    3: "received a damaged packet",
    4: "value out of range",
    5: "wrong data length",
    6: "value beyond its limits",
    7: "register is read-only now",
}


def units(value: float, unit: float) -> int:
    """value in whole units, at least 1: 0 would mean unlimited."""
    return max(1, round(value / unit))
