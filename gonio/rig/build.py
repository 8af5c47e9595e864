"""From a rig's config and its calibration to axes, kinematics, envelope and radiometry."""

import datetime as dt
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gonio.config import rig as config_of
from gonio.config.rig import RigConfig
from gonio.geometry import Array, unit
from gonio.rig.calibration import CameraCalibration, GeometryCalibration, RadiometryCalibration, load_calibration
from gonio.rig.devices import Axis
from gonio.rig.errors import CalibrationMissing
from gonio.rig.kinematics.base import Kinematics
from gonio.rig.kinematics.chain import Chain, Joint
from gonio.rig.kinematics.encoders import Encoders
from gonio.rig.kinematics.gantry import Gantry
from gonio.rig.kinematics.gimbal import Gimbal
from gonio.rig.motion.envelope import Envelope
from gonio.rig.signal.frames import Frames, load_frames
from gonio.rig.signal.radiometry import Radiometry, nominal
from gonio.rig.signal.view import View, facing, rotation_of
from gonio.rig.stale import refuse_stale

X, Y, Z = np.eye(3)


def axes_of(config: RigConfig) -> tuple[Axis, ...]:
    """The axes in the order of a pose, in radians."""
    axes = []
    for name in config.axis_names:
        a = config.axes[name]
        lower, upper, v, acc = np.radians([a.lower_deg, a.upper_deg, a.velocity_deg_s, a.acceleration_deg_s2]).tolist()
        axes.append(Axis(name, lower, upper, v, acc, 2 * np.pi / a.counts_per_turn if a.counts_per_turn else 0.0))
    return tuple(axes)


def kinematics_of(config: RigConfig, calibration: GeometryCalibration | None = None) -> Kinematics:
    """The rig's geometry: closed form unless it is not as drawn, in the encoders' angles."""
    joints: Kinematics
    if isinstance(config.kinematics, config_of.Chain) or (calibration is not None and _bent(calibration)):
        joints = chain_of(config, calibration)
    else:
        joints = Gantry() if isinstance(config.kinematics, config_of.Gantry) else Gimbal()
    offset, eccentric = offset_of(config, calibration), eccentricity_of(config, calibration)
    return Encoders(joints, offset, eccentric) if offset.any() or eccentric.any() else joints


def _bent(c: GeometryCalibration) -> bool:
    """Whether more than the encoders is not as drawn."""
    return bool(c.axes) or bool(c.centres) or c.height != 0 or any(c.lie_deg)


def offset_of(config: RigConfig, calibration: GeometryCalibration | None) -> Array:
    """What the encoders show at each joint's zero (A,)."""
    found = calibration.offsets_deg if calibration else {}
    return np.radians([config.axes[name].offset_deg + found.get(name, 0.0) for name in config.axis_names])


def eccentricity_of(config: RigConfig, calibration: GeometryCalibration | None) -> Array:
    """Of each encoder: sine and cosine of one turn, of two (A, 4), rad."""
    found = calibration.eccentricity_deg if calibration else {}
    return np.radians([found.get(name, (0.0, 0.0, 0.0, 0.0)) for name in config.axis_names])


def backlash_of(config: RigConfig, calibration: GeometryCalibration | None) -> Array:
    """How far each arm may lag behind its encoder (A,), rad."""
    found = calibration.backlash_deg if calibration else {}
    known = [max(config.axes[name].backlash_deg + found.get(name, 0.0), 0.0) for name in config.axis_names]
    return np.asarray(np.radians(known))


def chain_of(config: RigConfig, calibration: GeometryCalibration | None = None) -> Chain:
    """Any rig as a chain of joints, in the joints' angles."""
    c = config.kinematics
    bent = calibration or GeometryCalibration(id="-", date=dt.datetime(2000, 1, 1), rig=config.name)
    if isinstance(c, config_of.Gantry):
        return gantry_chain(bent.axes, bent)
    if isinstance(c, config_of.Gimbal):
        return gimbal_chain(bent.axes, bent)
    nearest: Kinematics = Gantry() if c.nearest == "gantry" else Gimbal()
    light, detector, sample = (
        [Joint(j.name, np.array(bent.axes.get(j.name, j.axis))) for j in part]
        for part in (c.light, c.detector, c.sample)
    )
    frame = _frame(np.array(c.normal_rest), np.array(c.mark_rest))
    rests = np.array(c.light_rest), np.array(c.detector_rest)
    return _chain(light, detector, sample, nearest, *rests, frame, config.axis_names, bent)


def gantry_chain(axes: Mapping[str, Sequence[float]], bent: GeometryCalibration | None = None) -> Chain:
    """The gantry as a chain of joints, with `axes` instead of the nominal ones."""
    joint = lambda name, nominal: Joint(name, np.array(axes.get(name, nominal), float))
    detector = [joint("azimuth", Z), joint("detector", Y)]
    table = [joint("turntable", Z)]
    return _chain([joint("light", Y)], detector, table, Gantry(), Z, Z, np.eye(3), Gantry.names, bent)


def gimbal_chain(axes: Mapping[str, Sequence[float]], bent: GeometryCalibration | None = None) -> Chain:
    """The gimbal and swing-arm rig as a chain of joints, with `axes` instead of the nominal ones."""
    joint = lambda name, nominal: Joint(name, np.array(axes.get(name, nominal), float))
    sample = [joint("yaw", Z), joint("tilt", -Y), joint("roll", X)]
    frame = np.stack([Y, Z, X], 1)
    return _chain([], [joint("detector", Z)], sample, Gimbal(), X, X, frame, Gimbal.names, bent)


def _chain(light, detector, sample, nearest, l0, d0, frame, names, bent: GeometryCalibration | None) -> Chain:
    """A chain whose arms' centres and sample lie as a calibration says."""
    if bent is None:
        return Chain(light, detector, sample, nearest, l0, d0, frame, names)
    centres = np.array([bent.centres.get(arm, (0.0, 0.0, 0.0)) for arm in ("light", "detector")])
    lying = frame @ rotation_of(np.radians([*bent.lie_deg, 0.0]))
    return Chain(light, detector, sample, nearest, l0, d0, lying, names, centres, bent.height)


def envelope_of(config: RigConfig, calibration: GeometryCalibration | None = None) -> Envelope:
    """Where the rig may be."""
    return Envelope(kinematics_of(config, calibration), axes_of(config), float(np.radians(config.stay_out_deg)))


def view_of(
    config: RigConfig, geometry: GeometryCalibration | None = None, camera: CameraCalibration | None = None
) -> View:
    """What the camera on the detector arm sees; without a calibration of it, as drawn."""
    c = config.camera
    chain = chain_of(config, geometry)
    encoders = Encoders(chain, offset_of(config, geometry), eccentricity_of(config, geometry))
    rest = chain.detector_rest
    drawn = np.array([[c.focal_px, 0, (c.width - 1) / 2], [0, c.focal_px, (c.height - 1) / 2], [0, 0, 1]])
    matrix, distortion = (np.array(camera.matrix), np.array(camera.distortion)) if camera else (drawn, np.zeros(5))
    size = camera.size if camera else (c.width, c.height)
    turn, shift = facing(rest), np.array([0.0, 0.0, c.distance_mm / 1000])
    if camera is not None and camera.mount_rotation is not None and camera.mount_m is not None:
        turn, shift = rotation_of(np.array(camera.mount_rotation)), np.array(camera.mount_m)
    return View(matrix, distortion, size, turn, shift, lambda pose: chain.arm(encoders.joint(pose)))


def park_pose(config: RigConfig) -> Array:
    """The pose of rest (A,)."""
    return np.radians([config.park_deg.get(name, 0.0) for name in config.axis_names])


def geometry_calibration(config: RigConfig) -> GeometryCalibration | None:
    """The geometry that the rig refers to, None = as drawn. Raises CalibrationMissing."""
    c = config.calibration
    if c.geometry is None:
        return None
    found = load_calibration(Path(c.geometry), GeometryCalibration)
    for key in ("offsets_deg", "axes", "eccentricity_deg", "backlash_deg"):
        for name in getattr(found, key):
            if name not in config.axis_names:
                raise CalibrationMissing(
                    f"{c.geometry}: {key}.{name}: no such axis; they are {', '.join(config.axis_names)}"
                )
    for name, waves in found.eccentricity_deg.items():
        if not all(abs(w) <= 10 for w in waves):
            raise CalibrationMissing(f"{c.geometry}: eccentricity_deg.{name}: more than 10 degrees is no encoder")
    return found


def camera_calibration(config: RigConfig, *, to_measure: bool = True) -> CameraCalibration | None:
    """The optics and the mount that the rig refers to, None = as drawn. Raises CalibrationMissing.

    A real rig whose detector is a camera has to know where its camera looks if it is to measure f.
    """
    c, real = config.calibration, config.depth == "real" and to_measure
    if c.camera is None:
        if real:
            raise CalibrationMissing(f"rig {config.name}: no calibration.camera; run `gonio calibrate camera`")
        return None
    found = load_calibration(Path(c.camera), CameraCalibration)
    if real and found.mount_m is None:
        raise CalibrationMissing(
            f"{c.camera}: does not say where the camera sits; run `gonio calibrate camera` with --poses"
        )
    if found.size != (config.camera.width, config.camera.height):
        raise CalibrationMissing(
            f"{c.camera}: made for pictures of {found.size[0]} x {found.size[1]}, the rig takes "
            f"{config.camera.width} x {config.camera.height}"
        )
    return found


def camera_frames(config: RigConfig) -> Frames | None:
    """The dark and flat frames that the rig refers to, None = learnt at its start. Raises CalibrationMissing."""
    c, camera = config.calibration, config.camera
    if c.frames is None:
        return None
    return load_frames(
        Path(c.frames), camera.exposure_s, (camera.width, camera.height), None if c.allow_stale else c.max_age_days
    )


def nominal_radiometry(config: RigConfig, channels: int) -> Radiometry:
    """That of a detector as drawn: exact for a simulated one; a real one may be moved and calibrated with it."""
    p, sensor = config.photodiode, config.camera.sensor
    if config.detector == "camera":
        gain = np.pi * sensor.white_per_s / sensor.electrons_per_count  # counts per second of f = 1
        return Radiometry(np.full(channels, gain), np.zeros(channels), config.footprint)
    return nominal(channels, config.exposure_s, config.footprint, p.nonlinearity)


def radiometry_of(config: RigConfig, channels: int) -> Radiometry:
    """How readings become f. Without a calibration, the nominal gain of the simulated detector.

    Raises CalibrationMissing where a file is missing, stale, of other channels, or a real rig names none.
    """
    c = config.calibration
    refuse_stale(config)
    if c.radiometry is None:
        if config.depth == "real":
            raise CalibrationMissing(f"rig {config.name}: no calibration.radiometry; run `gonio calibrate radiometry`")
        return nominal_radiometry(config, channels)
    found = load_calibration(Path(c.radiometry), RadiometryCalibration)
    kind = config.detector_kind
    if found.detector != kind:
        raise CalibrationMissing(f"{c.radiometry}: made with a {found.detector}, the rig has a {kind}")
    if len(found.gain) != channels:
        raise CalibrationMissing(f"{c.radiometry}: made for {len(found.gain)} channels, the run has {channels}")
    ranges = len(config.full_scales)
    if found.range_ratios and len(found.range_ratios) != ranges:
        raise CalibrationMissing(f"{c.radiometry}: made for {len(found.range_ratios)} ranges, the rig has {ranges}")
    return Radiometry(
        np.array(found.gain),
        np.array(found.gain_sigma),
        config.footprint,
        found.linearity,
        found.id,
        np.array(found.range_ratios) if found.range_ratios else None,
        np.array(found.stray) if found.stray else None,
    )


def calibration_ids(config: RigConfig, geometry: GeometryCalibration | None, radiometry: Radiometry) -> dict[str, str]:
    """The calibrations in use, kind -> id."""
    found: dict[str, str | None] = {"geometry": geometry.id if geometry else None, "radiometry": radiometry.id}
    if config.detector == "camera":
        camera, frames = camera_calibration(config), camera_frames(config)
        found |= {"camera": camera.id if camera else None, "frames": frames.id if frames else None}
    return {kind: name for kind, name in found.items() if name}


def _frame(normal: Array, mark: Array) -> Array:
    """The sample's x, y, z axes as columns (3, 3)."""
    z = unit(normal)
    x = unit(mark - (mark @ z) * z)
    return np.stack([x, np.cross(z, x), z], 1)
