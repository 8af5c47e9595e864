"""Finds, names and tests the devices of a rig; moves nothing. Says what is, or what is missing and what to do.

Lines begin with `ok`, `warn` or `FAIL`.
"""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np

from drivers.camera import FrameSource
from drivers.doctor_camera import look, missing
from drivers.dynamixel import tables as t
from drivers.dynamixel.bus import Bus, Refused
from drivers.dynamixel.configure import Joint, hardware_fault
from drivers.gone import PortGone
from drivers.latency import latency_ms, too_slow
from drivers.light import SerialLight
from drivers.photodiode import Photodiode
from drivers.rig import make_stage, open_camera
from drivers.text_line import TextLine
from gonio.config.rig import DevicesConfig, PortConfig, RigConfig
from gonio.rig.build import camera_calibration, camera_frames, geometry_calibration, radiometry_of
from gonio.rig.calibration import RadiometryCalibration, load_calibration
from gonio.rig.clock import RealClock
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
    if (missing := _port("stage", devices.stage)) is not None:
        yield missing
        return
    if (ms := latency_ms(devices.stage.port)) is not None:
        slow = too_slow(devices.stage.port)
        yield f"warn stage: {slow}" if slow else f"ok   stage: USB latency timer {ms} ms"
    try:
        stage = make_stage(config, devices, RealClock())
        stage.bus.open()
    except (DeviceFault, PortGone) as e:
        yield f"FAIL {e if isinstance(e, DeviceFault) else f'stage: {e}; is another program using it?'}"
        return
    try:
        there = [j for j in stage.joints if stage.bus.answers(j.id)]
        for joint in stage.joints:
            if joint in there:
                yield from _servo(stage.bus, joint, stage.model)
            else:
                yield f"FAIL {joint.name}: no servo answers as id {joint.id}; check its cable, supply and id"
        if len(there) < len(stage.joints):
            found, _ = stage.bus.packets.broadcastPing(stage.bus.port)
            others = sorted(set(found) - {j.id for j in stage.joints})
            who = ", ".join(f"id {i} (model {found[i][0]})" for i in others) or "nobody"
            yield f"warn stage: besides these, at {devices.stage.baud} baud, {who} answers; other rates were not tried"
    except (DeviceFault, Refused, PortGone) as e:
        yield f"FAIL stage: {e}"
    finally:
        stage.bus.close()


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


def _optics(config: RigConfig, devices: DevicesConfig, frames: FrameSource | None) -> Iterator[str]:
    """Lamp and detector: alone, and the one in the light of the other."""
    light, light_works = None, False
    if devices.light is None:
        yield "warn light: none is configured; switch it yourself, or name its port under devices.light"
    elif (wrong := _port("light", devices.light)) is not None:
        yield wrong
    else:
        light = SerialLight(
            TextLine("light", devices.light.port, devices.light.baud, grace_s=0, boot_s=devices.light.boot_s),
            RealClock(),
        )
    try:
        if light is not None:
            light.connect()
            yield "ok   light: answers, off"
            light_works = True
    except DeviceFault as e:
        yield f"FAIL {e}"
    try:
        known = light if light_works else None
        if config.detector == "camera":
            yield from _camera(config, devices, known, frames)
        else:
            yield from _photodiode(config, devices, known)
    finally:
        if light is not None:
            try:
                light.off()
            except DeviceFault as e:
                yield f"FAIL {e}"
            light.close()


def _camera(
    config: RigConfig, devices: DevicesConfig, light: SerialLight | None, frames: FrameSource | None
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


def _photodiode(config: RigConfig, devices: DevicesConfig, light: SerialLight | None) -> Iterator[str]:
    if devices.photodiode is None:
        yield "warn photodiode: none is configured; name its port under devices.photodiode"
        return
    if (wrong := _port("photodiode", devices.photodiode)) is not None:
        yield wrong
        return
    line = TextLine(
        "photodiode", devices.photodiode.port, devices.photodiode.baud, grace_s=0, boot_s=devices.photodiode.boot_s
    )
    detector = Photodiode(line, config.photodiode, config.exposure_s)
    try:
        detector.connect()
        yield from _levels(config, detector, light)
    except DeviceFault as e:
        yield f"FAIL {e}"
    finally:
        detector.close()


def _levels(config: RigConfig, detector: Photodiode, light: SerialLight | None) -> Iterator[str]:
    dark = np.mean([detector.read().value for _ in range(READINGS)], 0)
    expected = config.photodiode.dark
    yield f"ok   photodiode: {detector.channels} channels, dark level {', '.join(f'{v:.3g}' for v in dark)}"
    if np.any(np.abs(dark - expected) > max(5 * config.photodiode.read_noise, 0.5 * abs(expected))):
        yield f"warn photodiode: dark level should be about {expected:g}; is there stray light?"
    if light is None:
        return
    light.on()
    light.level(1)
    lit = np.mean([detector.read().value for _ in range(READINGS)], 0)
    light.off()
    step = lit - dark
    if np.any(step < 10 * config.photodiode.read_noise):
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


def _port(name: str, port: PortConfig) -> str | None:
    """What is wrong with a port before it is opened, None where nothing is."""
    if not os.path.exists(port.port):
        others = ", ".join(str(p) for p in sorted(Path("/dev/serial/by-id").glob("*"))) or "none"
        return f"FAIL {name}: {port.port} is not there; plug it in, or name one of those found: {others}"
    if not os.access(port.port, os.R_OK | os.W_OK):
        return f"FAIL {name}: {port.port} may not be opened; have your user added to its group (often dialout)"
    return None
