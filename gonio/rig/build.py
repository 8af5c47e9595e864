"""From a rig's config and its calibration to axes, kinematics, envelope and radiometry."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from gonio.config import rig as config_of
from gonio.config.rig import RigConfig
from gonio.geometry import Array, unit
from gonio.rig.calibration import GeometryCalibration, RadiometryCalibration, load_calibration
from gonio.rig.chain import Chain, Joint
from gonio.rig.devices import Axis
from gonio.rig.envelope import Envelope
from gonio.rig.errors import CalibrationMissing
from gonio.rig.gimbal import Gimbal
from gonio.rig.kinematics import Gantry, Kinematics
from gonio.rig.offsets import Offsets
from gonio.rig.radiometry import Radiometry, nominal

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
    """The rig's geometry: closed form unless its axes are tilted, in the encoders' angles."""
    c = config.kinematics
    tilts: Mapping[str, Sequence[float]] = calibration.axes if calibration else {}
    found = calibration.offsets_deg if calibration else {}
    joints: Kinematics
    if isinstance(c, config_of.Chain):
        nearest: Kinematics = Gantry() if c.nearest == "gantry" else Gimbal()
        light, detector, sample = (
            [Joint(j.name, np.array(tilts.get(j.name, j.axis))) for j in part]
            for part in (c.light, c.detector, c.sample)
        )
        frame = _frame(np.array(c.normal_rest), np.array(c.mark_rest))
        rests = np.array(c.light_rest), np.array(c.detector_rest)
        joints = Chain(light, detector, sample, nearest, *rests, frame, config.axis_names)
    elif isinstance(c, config_of.Gantry):
        joints = gantry_chain(tilts) if tilts else Gantry()
    else:
        joints = gimbal_chain(tilts) if tilts else Gimbal()
    offset = [config.axes[name].offset_deg + found.get(name, 0.0) for name in config.axis_names]
    return Offsets(joints, np.radians(offset)) if any(offset) else joints


def gantry_chain(axes: Mapping[str, Sequence[float]]) -> Chain:
    """The gantry as a chain of joints, with `axes` instead of the nominal ones."""
    joint = lambda name, nominal: Joint(name, np.array(axes.get(name, nominal), float))
    detector = [joint("azimuth", Z), joint("detector", Y)]
    return Chain([joint("light", Y)], detector, [joint("turntable", Z)], Gantry(), Z, Z, np.eye(3), Gantry.names)


def gimbal_chain(axes: Mapping[str, Sequence[float]]) -> Chain:
    """The gimbal and swing-arm rig as a chain of joints, with `axes` instead of the nominal ones."""
    joint = lambda name, nominal: Joint(name, np.array(axes.get(name, nominal), float))
    sample = [joint("yaw", Z), joint("tilt", -Y), joint("roll", X)]
    return Chain([], [joint("detector", Z)], sample, Gimbal(), X, X, np.stack([Y, Z, X], 1), Gimbal.names)


def envelope_of(config: RigConfig, calibration: GeometryCalibration | None = None) -> Envelope:
    """Where the rig may be."""
    return Envelope(kinematics_of(config, calibration), axes_of(config), float(np.radians(config.stay_out_deg)))


def park_pose(config: RigConfig) -> Array:
    """The pose of rest (A,)."""
    return np.radians([config.park_deg.get(name, 0.0) for name in config.axis_names])


def geometry_calibration(config: RigConfig) -> GeometryCalibration | None:
    """The geometry that the rig refers to, None = as drawn. Raises CalibrationMissing."""
    c = config.calibration
    return load_calibration(Path(c.geometry), GeometryCalibration, c.max_age_days) if c.geometry else None


def radiometry_of(config: RigConfig, channels: int) -> Radiometry:
    """How readings become f. Without a calibration, the nominal gain of the simulated detector.

    Raises CalibrationMissing where the file is missing, stale, of other channels, or a real rig names none.
    """
    c, p = config.calibration, config.photodiode
    if c.radiometry is None:
        if config.depth == "real":
            raise CalibrationMissing(f"rig {config.name}: no calibration.radiometry; run `gonio calibrate radiometry`")
        return nominal(channels, config.exposure_s, p.footprint, p.nonlinearity)
    found = load_calibration(Path(c.radiometry), RadiometryCalibration, c.max_age_days)
    if len(found.gain) != channels:
        raise CalibrationMissing(f"{c.radiometry}: made for {len(found.gain)} channels, the run has {channels}")
    return Radiometry(np.array(found.gain), np.array(found.gain_sigma), p.footprint, found.linearity, found.id)


def _frame(normal: Array, mark: Array) -> Array:
    """The sample's x, y, z axes as columns (3, 3)."""
    z = unit(normal)
    x = unit(mark - (mark @ z) * z)
    return np.stack([x, np.cross(z, x), z], 1)
