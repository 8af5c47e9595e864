"""Opens a rig of real drivers, on the ports that its config names."""

from collections.abc import Callable
from contextlib import ExitStack

import numpy as np

from drivers.dynamixel.bus import Bus
from drivers.dynamixel.stage import DynamixelStage
from drivers.light import SerialLight
from drivers.photodiode import Photodiode
from drivers.text_line import TextLine
from gonio.config.plan import PlanConfig
from gonio.config.rig import DevicesConfig, RigConfig
from gonio.rig.build import envelope_of, geometry_calibration, park_pose, radiometry_of
from gonio.rig.clock import Clock, RealClock
from gonio.rig.errors import DeviceFault
from gonio.rig.staged import StagedRig

POLL_S = 0.02  # machine seconds between two polls of servos on the move


def open_real(config: RigConfig, plan: PlanConfig, isotropic: bool) -> StagedRig:
    """A rig of hardware, homed and ready. Raises DeviceFault, CalibrationMissing."""
    return assemble(config, config.devices, plan, isotropic, RealClock())


def assemble(
    config: RigConfig,
    devices: DevicesConfig,
    plan: PlanConfig,
    isotropic: bool,
    clock: Clock,
    *,
    simulated: bool = False,
    announce: Callable[[int], None] = lambda number: None,
    make: Callable[..., StagedRig] = StagedRig,
) -> StagedRig:
    """Connect to every device, confirm that it is what it should be, and put them together; all let go on failure."""
    if devices.stage is None or devices.photodiode is None:
        raise DeviceFault("rig", "a stage and a photodiode are needed", "name their ports under `devices`")
    geometry = geometry_calibration(config)
    envelope = envelope_of(config, geometry)
    with ExitStack() as opened:
        detector = Photodiode(
            TextLine("photodiode", devices.photodiode.port, devices.photodiode.baud),
            config.photodiode,
            config.exposure_s,
        )
        opened.callback(detector.close)
        detector.connect()
        radiometry = radiometry_of(config, detector.channels)
        light: SerialLight | NoLight = NoLight()
        if devices.light is not None:
            line = TextLine("light", devices.light.port, devices.light.baud)
            light = SerialLight(line, clock, config.light.warm_up_s)
            opened.callback(light.close)
            light.connect()
        stage = open_stage(config, devices, clock)
        opened.callback(stage.close)
        stage.home()
        rig = make(
            config, envelope, stage, detector, light, radiometry, clock, plan, isotropic,
            simulated=simulated, announce=announce, release=opened.pop_all().close,
        )  # fmt: skip
    rig.calibration_ids = {k: c.id for k, c in (("geometry", geometry), ("radiometry", radiometry)) if c and c.id}
    return rig


def open_stage(config: RigConfig, devices: DevicesConfig, clock: Clock) -> DynamixelStage:
    """The servos, recognised and configured; not homed. Raises DeviceFault."""
    stage = make_stage(config, devices, clock)
    stage.connect()
    return stage


def reboot(config: RigConfig, axis: str) -> None:
    """The operator's command: restart one servo that has shut itself down, and write its settings again.

    Its arm may sag. Raises DeviceFault, KeyError.
    """
    stage = make_stage(config, config.devices, RealClock())
    try:
        stage.bus.open()
        stage.reboot(axis)
    finally:
        stage.close()


def make_stage(config: RigConfig, devices: DevicesConfig, clock: Clock) -> DynamixelStage:
    """Not connected yet."""
    s = devices.stage
    if s is None:
        raise DeviceFault("stage", "none is configured", "name its port under devices.stage")
    envelope = envelope_of(config, None)
    return DynamixelStage(
        Bus(s.port, s.baud, {number: name for name, number in s.ids.items()}),
        envelope.axes,
        s.ids,
        s.model,
        envelope.snap(np.asarray(park_pose(config))),
        clock,
        watchdog_s=s.watchdog_s,
        after_fault=s.after_fault,
        poll_s=min(POLL_S, s.watchdog_s / 4) * getattr(clock, "scale", 1.0),
    )


class NoLight:
    """A rig whose lamp has no wire to it: the operator switches it."""

    def on(self) -> None: ...

    def off(self) -> None: ...

    def level(self, fraction: float) -> None: ...
