"""The doctor's findings on servos: who answers, whether it is well and where it stands. Nothing is written or moved."""

from collections.abc import Iterator

from drivers.dynamixel import old
from drivers.dynamixel import tables as t
from drivers.dynamixel.bus import Bus, Refused
from drivers.dynamixel.configure import Joint, hardware_fault
from drivers.dynamixel.stage import DynamixelStage
from drivers.gone import PortGone
from drivers.latency import latency_ms, too_slow
from gonio.rig.errors import DeviceFault


def examine(stage: DynamixelStage) -> Iterator[str]:
    """Findings on every servo of a stage that is not connected."""
    port, baud = stage.bus.port.port_name, stage.bus.baud
    if (ms := latency_ms(port)) is not None:
        slow = too_slow(port)
        yield f"warn stage: {slow}" if slow else f"ok   stage: USB latency timer {ms} ms"
    try:
        stage.bus.open()
    except (DeviceFault, PortGone) as e:
        yield f"FAIL {e if isinstance(e, DeviceFault) else f'stage: {e}; is another program using it?'}"
        return
    try:
        there = [j for j in stage.joints if stage.bus.answers(j.id)]
        for joint in stage.joints:
            if joint in there:
                yield from _servo(stage.bus, joint, stage.model)
            elif (model := old.found(stage.bus, joint.id)) is not None:
                yield f"FAIL {old.refusal(joint.name, joint.id, model)}"
            else:
                yield f"FAIL {joint.name}: no servo answers as id {joint.id}; check its cable, supply and id"
        if len(there) < len(stage.joints):
            found, _ = stage.bus.packets.broadcastPing(stage.bus.port)
            others = sorted(set(found) - {j.id for j in stage.joints})
            who = ", ".join(f"id {i} (model {found[i][0]})" for i in others) or "nobody"
            yield f"warn stage: besides these, at {baud} baud, {who} answers; other rates were not tried"
    except (DeviceFault, Refused, PortGone) as e:
        yield f"FAIL stage: {e}"


def _servo(bus: Bus, joint: Joint, model: str) -> Iterator[str]:
    number = bus.ping(joint.id)
    known = {n: name for name, n in t.MODELS.items()}.get(number, f"model {number}")
    if number != t.MODELS[model]:
        yield f"FAIL {joint.name}: servo {joint.id} is {known}, not {model}; check devices.stage.model and ids"
        return
    volts, celsius = bus.read(joint.id, t.VOLTAGE) / 10, bus.read(joint.id, t.TEMPERATURE)
    low, high = bus.read(joint.id, t.MIN_VOLTAGE) / 10, bus.read(joint.id, t.MAX_VOLTAGE) / 10
    hottest = bus.read(joint.id, t.TEMPERATURE_LIMIT)
    position = bus.read(joint.id, t.PRESENT_POSITION)
    degrees = (position - t.ZERO) * 360 / t.COUNTS
    yield (
        f"ok   {joint.name}: {known} id {joint.id}, firmware {bus.read(joint.id, t.FIRMWARE)}, {volts:.1f} V, "
        f"{celsius} C, at {degrees:.2f} degrees"
    )
    if fault := hardware_fault(joint.name, bus.read(joint.id, t.HARDWARE_ERROR)):
        yield f"FAIL {fault}"
    if not low <= volts <= high:
        yield f"FAIL {joint.name}: {volts:.1f} V is outside {low:.1f} to {high:.1f} V; check the supply"
    if celsius > hottest - 10:
        yield f"warn {joint.name}: {celsius} C, it stops at {hottest} C; let it cool down"
    if not joint.lower <= position <= joint.upper:
        yield f"FAIL {joint.name}: stands outside its limits; move it inside by hand with the power off"
    for register, value, what in ((t.MIN_POSITION, joint.lower, "lower"), (t.MAX_POSITION, joint.upper, "upper")):
        if (kept := bus.read(joint.id, register)) != value:
            yield f"warn {joint.name}: its own {what} limit is {kept} counts, not {value}; written at the next start"
