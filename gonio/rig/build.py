"""From a rig's config to its axes, kinematics and envelope."""

import numpy as np

from gonio.config.rig import Gantry as GantryConfig
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.devices import Axis
from gonio.rig.envelope import Envelope
from gonio.rig.kinematics import Gantry, Kinematics
from gonio.rig.radiometry import Radiometry, nominal


def axes_of(config: RigConfig) -> tuple[Axis, ...]:
    """The axes in the order of a pose, in radians."""
    axes = []
    for name in config.axis_names:
        a = config.axes[name]
        lower, upper, v, acc = np.radians([a.lower_deg, a.upper_deg, a.velocity_deg_s, a.acceleration_deg_s2]).tolist()
        axes.append(Axis(name, lower, upper, v, acc, 2 * np.pi / a.counts_per_turn if a.counts_per_turn else 0.0))
    return tuple(axes)


def kinematics_of(config: RigConfig) -> Kinematics:
    """The rig's geometry."""
    if isinstance(config.kinematics, GantryConfig):
        return Gantry()
    raise NotImplementedError(config.kinematics.kind)


def envelope_of(config: RigConfig) -> Envelope:
    """Where the rig may be."""
    return Envelope(kinematics_of(config), axes_of(config), float(np.radians(config.stay_out_deg)))


def park_pose(config: RigConfig) -> Array:
    """The pose of rest (A,)."""
    return np.radians([config.park_deg.get(name, 0.0) for name in config.axis_names])


def radiometry_of(config: RigConfig, channels: int) -> Radiometry:
    """How readings become f. Simulated rigs without a calibration know their nominal gain."""
    p = config.photodiode
    return nominal(channels, config.exposure_s, p.footprint, p.nonlinearity)
