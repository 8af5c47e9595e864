"""Opens a rig of real drivers, on the ports that its config names."""

import logging
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from typing import Any

from drivers.camera import Camera, FrameSource
from drivers.camera_detector import CameraDetector
from drivers.dynamixel.stage import DynamixelStage
from drivers.latency import too_slow
from gonio.config.devices import DevicesConfig, PhotodiodePort, ServoBusConfig
from gonio.config.loader import ConfigError
from gonio.config.plan import PlanConfig
from gonio.config.plugins import DetectorSection, DeviceSection, driver
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import (
    calibration_ids,
    camera_calibration,
    camera_frames,
    envelope_of,
    geometry_calibration,
    nominal_radiometry,
    radiometry_of,
    view_of,
)
from gonio.rig.clock import Clock, RealClock
from gonio.rig.driver import Setting
from gonio.rig.errors import CalibrationMissing, DeviceFault
from gonio.rig.staged import StagedRig

log = logging.getLogger(__name__)


def open_real(config: RigConfig, plan: PlanConfig, isotropic: bool, *, calibrated: bool = True) -> StagedRig:
    """A rig of hardware, homed and ready. Raises DeviceFault, CalibrationMissing.

    calibrated: it is to measure f. One that is only to be moved, or is about to be calibrated, needs no radiometry.
    """
    return assemble(config, config.devices, plan, isotropic, RealClock(), calibrated=calibrated)


def assemble(
    config: RigConfig,
    devices: DevicesConfig,
    plan: PlanConfig,
    isotropic: bool,
    clock: Clock,
    *,
    calibrated: bool = True,
    simulated: bool = False,
    announce: Callable[[int], None] = lambda number: None,
    rig_of: Callable[..., StagedRig] = StagedRig,
    frames: FrameSource | None = None,
    even: Callable[[float], AbstractContextManager[None]] | None = None,
) -> StagedRig:
    """Connect to every device, confirm that it is what it should be, and put them together; all let go on failure.

    frames: the camera's sensor, where it is not the one that `devices` names; even(t) puts a
    diffuser before it that is half full at an exposure of t seconds.
    """
    geometry = geometry_calibration(config)
    envelope = envelope_of(config, geometry)
    stage = make_stage(config, devices, clock)
    if isinstance(devices.stage, ServoBusConfig) and (slow := too_slow(devices.stage.port)) is not None:
        log.warning("stage: %s", slow)
    with ExitStack() as opened:
        light: Any = NoLight()
        if devices.light is not None:
            light = make(devices.light, Setting(config, clock))
            opened.callback(light.close)
            light.connect()  # and off: a camera learns its darks now
        detector: Any
        if config.detector == "camera":
            source = frames or open_camera(config, devices)
            opened.callback(source.close)
            detector = camera_detector(config, source, stage.pose, calibrated=calibrated, even=even)
        else:
            detector = open_detector(config, devices, clock)
            opened.callback(detector.close)
        radiometry = (radiometry_of if calibrated else nominal_radiometry)(config, detector.channels)
        stage.connect()
        opened.callback(stage.close)
        stage.home()
        rig = rig_of(
            config, envelope, stage, detector, light, radiometry, clock, plan, isotropic,
            simulated=simulated, announce=announce, release=opened.pop_all().close,
        )  # fmt: skip
    rig.calibration_ids = calibration_ids(config, geometry, radiometry)
    return rig


def open_detector(config: RigConfig, devices: DevicesConfig, clock: Clock) -> Any:
    """The detector that the rig names, if it is no camera; connected. Raises DeviceFault, ConfigError."""
    detector = make(detector_section(config, devices), Setting(config, clock))
    try:
        detector.connect()
    except BaseException:
        detector.close()
        raise
    return detector


def detector_section(config: RigConfig, devices: DevicesConfig) -> DetectorSection:
    """What says how the detector is connected, if it is no camera. Raises DeviceFault where nothing does."""
    if isinstance(config.detector, DetectorSection):
        return config.detector
    if devices.photodiode is None:
        raise DeviceFault("photodiode", "none is configured", "name its port under devices.photodiode")
    return PhotodiodePort(**devices.photodiode.model_dump())


def make(section: DeviceSection, setting: Setting) -> Any:
    """The device of a section, not connected yet. Raises ConfigError where its driver is not installed, DeviceFault."""
    return driver(section.group, section.driver)(section, setting)


def open_camera(config: RigConfig, devices: DevicesConfig) -> FrameSource:
    """The sensor on its USB port. Raises DeviceFault."""
    if devices.camera is None:
        raise DeviceFault("camera", "none is configured", "name it under devices.camera")
    from drivers.v4l2 import V4l2Source

    return V4l2Source(devices.camera, config.camera)


def camera_detector(
    config: RigConfig,
    source: FrameSource,
    pose: Callable[[], Array],
    *,
    calibrated: bool = True,
    even: Callable[[float], AbstractContextManager[None]] | None = None,
) -> CameraDetector:
    """A sensor made the rig's detector: set, its dark frames known, its region following pose() (A,).

    Where no frames are named the dark ones are learnt now, the light being off, and the flat one where something evenly
    bright can be put before it. Raises DeviceFault, CalibrationMissing.
    """
    camera = Camera(source, config.camera)
    camera.configure()
    try:
        known = camera_frames(config)
    except CalibrationMissing:
        if calibrated:
            raise
        known = None  # it is about to be made anew
    if known is not None:
        camera.use(known)
    else:
        camera.learn_dark()
        if even is not None:
            with even(camera.middle_exposure):
                camera.learn_flat()
    view = view_of(config, geometry_calibration(config), camera_calibration(config, to_measure=calibrated))
    diameter = config.camera.region_mm / 1000
    return CameraDetector(camera, config.exposure_s, lambda: view.disk(diameter, pose()))


def reboot(config: RigConfig, axis: str) -> None:
    """The operator's command: restart one servo that has shut itself down, and write its settings again.

    Its arm may sag. Raises DeviceFault, KeyError.
    """
    stage = make_stage(config, config.devices, RealClock())
    if not isinstance(stage, DynamixelStage):
        raise ConfigError(f"--reboot {axis}: rig {config.name} has no servos that restart by themselves")
    try:
        stage.bus.open()
        stage.reboot(axis)
    finally:
        stage.close()


def make_stage(config: RigConfig, devices: DevicesConfig, clock: Clock) -> Any:
    """Not connected yet."""
    if devices.stage is None:
        raise DeviceFault("stage", "none is configured", "name its port under devices.stage")
    return make(devices.stage, Setting(config, clock))


class NoLight:
    """A rig whose lamp has no wire to it: the operator switches it."""

    def on(self) -> None: ...

    def off(self) -> None: ...

    def level(self, fraction: float) -> None: ...
