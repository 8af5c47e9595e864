"""The doctor's findings on a Grbl controller: what it is, what it does, whether its settings do for the rig."""

from collections.abc import Iterator

import numpy as np

from drivers.gone import PortGone
from drivers.grbl import codes
from drivers.grbl.stage import LETTERS, GrblStage

SOFT_LIMITS, HARD_LIMITS, HOMING, IDLE_LOCK = 20, 21, 22, 1


def examine(stage: GrblStage) -> Iterator[str]:
    """Of a stage that is not connected; nothing moves. Raises DeviceFault."""
    controller = stage.controller
    try:
        controller.open()
        report, settings = controller.report(), controller.settings()
    except PortGone as e:
        raise controller.gone(e) from None
    yield f"ok   stage: {controller.banner or 'answers, was not restarted'}, {report.state}"
    if report.state == "Alarm":
        yield f"warn stage: {codes.error(9)[0]}; `gonio home` drives it to its switches"
    faults = stage.differences(settings)
    for fault in faults:
        yield f"FAIL {fault}"
    at = np.degrees(stage._angles(report))
    for axis, i, angle in zip(stage.axes, stage.index, at):
        travel, rate, ramp = (settings.get(n + i, float("nan")) for n in (130, 110, 120))
        yield (
            f"ok   {axis.name}: {LETTERS[i]}, at {angle:.2f} degrees, travel {travel:g} degrees, "
            f"{rate / 60:g} degrees/s, {ramp:g} degrees/s2"
        )
    if not settings.get(SOFT_LIMITS):
        yield "warn stage: soft limits are off; set $20=1, so that it refuses what lies outside by itself"
    if stage.homing and not settings.get(HOMING):
        yield "FAIL stage: homing is off; set $22=1 and fit switches, or say `homing: false` in devices.stage"
    if settings.get(IDLE_LOCK, 255) != 255:
        yield "warn stage: its motors let go when they rest; set $1=255, or arms sag and steps are lost"
