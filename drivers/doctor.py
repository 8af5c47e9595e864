"""Finds, names and tests the devices of a rig; moves nothing. Says what is, or what is missing and what to do.

Lines begin with `ok`, `warn` or `FAIL`.
"""

import os
from collections.abc import Generator, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from drivers.camera import FrameSource
from drivers.doctor_camera import look, missing
from drivers.rig import detector_section, make, open_camera
from gonio.config.devices import DevicesConfig
from gonio.config.loader import ConfigError
from gonio.config.plugins import DetectorSection, DeviceSection
from gonio.config.rig import RigConfig
from gonio.rig.build import camera_calibration, camera_frames, geometry_calibration, radiometry_of
from gonio.rig.calibration import RadiometryCalibration, load_calibration
from gonio.rig.clock import RealClock
from gonio.rig.devices import Light
from gonio.rig.driver import Setting
from gonio.rig.errors import CalibrationMissing, DeviceFault
from gonio.rig.stale import stale

READINGS = 16


def doctor(config: RigConfig, devices: DevicesConfig | None = None, frames: FrameSource | None = None) -> list[str]:
    """Findings, in the order of the wiring. Raises nothing that a device may cause.

    frames: the camera's sensor, where it is not the one that `devices` names.
    """
    devices = devices or config.devices
    return [*_stage(config, devices), *_optics(config, devices, frames), *_calibration(config)]


def _stage(config: RigConfig, devices: DevicesConfig) -> Iterator[str]:
    if devices.stage is None:
        yield "FAIL stage: none is configured; name its port under devices.stage"
        return
    stage = yield from _made("stage", config, devices.stage)
    if stage is None:
        return
    try:
        yield from stage.doctor()
    except DeviceFault as e:
        yield f"FAIL {e}"
    finally:
        stage.close()


def _made(name: str, config: RigConfig, section: DeviceSection) -> Generator[str, None, Any]:
    """The device of a section, not connected; None where that cannot be, and a line that says why."""
    for port in section.ports:
        if (wrong := _port(name, port)) is not None:
            yield wrong
            return None
    try:
        return make(section, Setting(config, RealClock(), patient=False))
    except (DeviceFault, ConfigError) as e:
        yield f"FAIL {e}" if isinstance(e, DeviceFault) else f"FAIL {name}: {e}"
        return None


def _optics(config: RigConfig, devices: DevicesConfig, frames: FrameSource | None) -> Iterator[str]:
    """Lamp and detector: alone, and the one in the light of the other."""
    light, light_works = None, False
    if devices.light is None:
        yield "warn light: none is configured; switch it yourself, or name its port under devices.light"
    else:
        light = yield from _made("light", config, devices.light)
    try:
        if light is not None:
            yield from light.doctor()
            light_works = True
    except DeviceFault as e:
        yield f"FAIL {e}"
    try:
        known = light if light_works else None
        if config.detector == "camera":
            yield from _camera(config, devices, known, frames)
        else:
            yield from _detector(config, devices, known)
    finally:
        if light is not None:
            try:
                light.off()
            except DeviceFault as e:
                yield f"FAIL {e}"
            light.close()


def _camera(
    config: RigConfig, devices: DevicesConfig, light: Light | None, frames: FrameSource | None
) -> Iterator[str]:
    if frames is None:
        if (wrong := missing(devices.camera)) is not None:
            yield wrong
            return
        try:
            frames = open_camera(config, devices)
        except DeviceFault as e:
            yield f"FAIL {e}"
            return
    yield from look(config, frames, light)


def _detector(config: RigConfig, devices: DevicesConfig, light: Light | None) -> Iterator[str]:
    if config.detector == "photodiode" and devices.photodiode is None:
        yield "warn photodiode: none is configured; name its port under devices.photodiode"
        return
    detector = yield from _made(config.detector_kind, config, detector_section(config, devices))
    if detector is None:
        return
    try:
        yield from detector.doctor()
        yield from _levels(config, detector, light)
    except DeviceFault as e:
        yield f"FAIL {e}"
    finally:
        detector.close()


def _levels(config: RigConfig, detector: Any, light: Light | None) -> Iterator[str]:
    kind, noise = config.detector_kind, config.photodiode
    darks = [detector.read() for _ in range(READINGS)]
    dark = np.mean([r.value for r in darks], 0)
    expected = noise.dark
    yield f"ok   {kind}: {detector.channels} channels, dark level {', '.join(f'{v:.3g}' for v in dark[:8])}"
    if np.any(np.abs(dark - expected) > max(5 * noise.read_noise, 0.5 * abs(expected))):
        yield f"warn {kind}: dark level should be about {expected:g} (photodiode.dark); is there stray light?"
    scatter, sigma = np.std([r.value for r in darks], 0).max(), np.mean([r.sigma for r in darks])
    if isinstance(config.detector, DetectorSection) and scatter > 3 * sigma:
        yield f"warn {kind}: dark readings scatter by {scatter:.2g}, sigma is {sigma:.2g}: set photodiode.read_noise"
    if light is None:
        return
    light.on()
    light.level(1)
    lit = np.mean([detector.read().value for _ in range(READINGS)], 0)
    light.off()
    step = lit - dark
    if not np.all(step >= 10 * noise.read_noise):
        yield "FAIL light: switching it on changes nothing; is it aimed at the sample, the detector too?"
    else:
        yield f"ok   light: on/off contrast {', '.join(f'{v:.3g}' for v in lit / np.maximum(np.abs(dark), 1e-12))}"


def _calibration(config: RigConfig) -> Iterator[str]:
    with suppress(CalibrationMissing):  # what is missing is said below
        for kind, why in stale(config).items():
            yield f"FAIL {kind}: {why}"
    files = config.calibration.model_copy(update={"allow_stale": True})
    config = config.model_copy(update={"calibration": files})
    try:
        found = geometry_calibration(config)
        yield f"ok   geometry: {found.id}" if found else "warn geometry: as drawn; run `gonio calibrate geometry`"
    except CalibrationMissing as e:
        yield f"FAIL geometry: {e}"
    try:
        c = config.calibration
        channels = len(load_calibration(Path(c.radiometry), RadiometryCalibration).gain) if c.radiometry else 1
        yield f"ok   radiometry: {radiometry_of(config, channels).id or 'nominal'}"
    except CalibrationMissing as e:
        yield f"FAIL radiometry: {e}"
    if config.detector != "camera":
        return
    try:
        optics = camera_calibration(config)
        yield f"ok   camera: {optics.id}" if optics else "warn camera: as drawn; run `gonio calibrate camera`"
        frames = camera_frames(config)
        yield f"ok   frames: {frames.id}" if frames else "ok   frames: none named; the dark is learnt at each start"
    except CalibrationMissing as e:
        yield f"FAIL camera: {e}"


def _port(name: str, port: str) -> str | None:
    """What is wrong with a serial port before it is opened, None where nothing is."""
    if "://" in port:
        return None
    if not os.path.exists(port):
        others = ", ".join(str(p) for p in sorted(Path("/dev/serial/by-id").glob("*"))) or "none"
        return f"FAIL {name}: {port} is not there; plug it in, or name one of those found: {others}"
    if not os.access(port, os.R_OK | os.W_OK):
        return f"FAIL {name}: {port} may not be opened; have your user added to its group (often dialout)"
    return None
