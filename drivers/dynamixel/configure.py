"""A servo made ready: recognised, written, read back. Done at start, after a reboot and after the bus was lost."""

from dataclasses import dataclass

from drivers.dynamixel import old
from drivers.dynamixel import tables as t
from drivers.dynamixel.bus import Bus, Refused
from gonio.rig.errors import DeviceFault

# a servo that has shut itself down obeys again only after this; nothing does it by itself
RESTART = "then reboot it or switch the servos' supply off and on"


@dataclass(frozen=True)
class Joint:
    """One servo: axis name, id, limits in counts, top speed in the servo's units."""

    name: str
    id: int
    lower: int
    upper: int
    velocity: int


def recognise(bus: Bus, joint: Joint, model: str) -> None:
    """Raises DeviceFault that says what was expected and what was found."""
    expected = t.MODELS[model]
    try:
        found = bus.ping(joint.id)
    except DeviceFault:
        if (old_model := old.found(bus, joint.id)) is not None:
            raise old.refusal(joint.name, joint.id, old_model) from None
        raise
    if found != expected:
        known = {number: name for name, number in t.MODELS.items()}.get(found, "unknown")
        raise DeviceFault(
            joint.name,
            f"servo {joint.id} should be {model} (model {expected}) and is {known} (model {found})",
            "check devices.stage.model and ids",
        )


def healthy(bus: Bus, joint: Joint) -> None:
    """Raises DeviceFault for what the servo itself says is wrong."""
    fault = hardware_fault(joint.name, bus.read(joint.id, t.HARDWARE_ERROR))
    if fault:
        raise fault


def hardware_fault(name: str, bits: int) -> DeviceFault | None:
    """The fault that the hardware error register tells of."""
    for bit, (cause, remedy) in t.HARDWARE_ERRORS.items():
        if bits >> bit & 1:
            return DeviceFault(name, cause, f"{remedy}; {RESTART}")
    return DeviceFault(name, f"hardware error {bits:#x}", RESTART) if bits else None


def configure(bus: Bus, joint: Joint, watchdog_s: float) -> None:
    """Every register that matters, EEPROM first. EEPROM is written only where it differs: it wears out."""
    eeprom = {
        t.RETURN_DELAY: 0,
        t.DRIVE_MODE: t.TIME_BASED,
        t.OPERATING_MODE: t.POSITION_MODE,
        t.HOMING_OFFSET: 0,
        t.SHUTDOWN: t.SHUTDOWN_MASK,
        t.VELOCITY_LIMIT: joint.velocity,
        t.MAX_POSITION: joint.upper,
        t.MIN_POSITION: joint.lower,
    }
    bus.write(joint.id, t.STATUS_RETURN, 2)  # first: without it nothing that follows is answered
    differs = {r: v for r, v in eeprom.items() if bus.read(joint.id, r) != v}
    if differs:
        bus.write(joint.id, t.TORQUE, 0)
        for register, value in differs.items():
            put(bus, joint, register, value)
    put(bus, joint, t.WATCHDOG, 0)  # ends a trip: until then goals are read-only
    put(bus, joint, t.POSITION_I_GAIN, t.I_GAIN)
    put(bus, joint, t.PROFILE_ACCELERATION, t.GENTLE_MS[0])
    put(bus, joint, t.PROFILE_VELOCITY, t.GENTLE_MS[1])
    put(bus, joint, t.TORQUE, 1)
    put(bus, joint, t.WATCHDOG, watchdog_units(watchdog_s))


def watchdog_units(seconds: float) -> int:
    return min(127, t.units(seconds, t.WATCHDOG_UNIT_S))


def put(bus: Bus, joint: Joint, register: t.Register, value: int) -> None:
    """Write and read back. Raises DeviceFault where the servo keeps something else."""
    try:
        bus.write(joint.id, register, value)
        found = bus.read(joint.id, register)
    except Refused as e:
        healthy(bus, joint)
        raise DeviceFault(
            joint.name, f"register {register.address} = {value} refused: {e}", "check the servo with `gonio doctor`"
        ) from None
    if found != value:
        raise DeviceFault(
            joint.name,
            f"register {register.address} should hold {value} and holds {found}",
            "check the servo with `gonio doctor`",
        )
