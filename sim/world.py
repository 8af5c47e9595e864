"""A rig as it really is: the hidden errors of `world`, in directions and in signal. No other room may know them.

Geometry: the joint stands where the encoder says, less offset and eccentricity e1 sin(q + a) + e2 sin(2 q + b); axes
are tilted; arms turn about centres that lie, in the lab, beside the sample's axes; the sample lies tilted and too high:
directions are those of points at `arm_mm`. Signal: beams that look beside the sample lose light; light and detector
polarised to a degree p, each across its arm, change the signal by 1 + p^2 cos 2 psi, psi the angle between the two; the
lamp drifts, and stray light comes with it; the dark signal follows the room; ranges differ, and the amplifier is not
linear.
"""

import datetime as dt
from dataclasses import dataclass

import numpy as np

from gonio.config import ConfigError
from gonio.config.rig import RigConfig
from gonio.config.world import World
from gonio.geometry import Array, unit
from gonio.rig.build import backlash_of, chain_of, kinematics_of
from gonio.rig.calibration import GeometryCalibration
from sim.noise import WORLD, generator

ROOM_S = 8 * 3600.0
ARMS = ("light", "detector")
# what a seed draws is even within these
OFFSET, TILT, BACKLASH, ECCENTRIC, MISS, BEAM = 2.0, 1.0, 0.25, 0.15, 0.5, 0.3  # degrees; mm
GAIN, RATIO, NONLINEAR, DRIFT, DARK, STRAY, POLARISED = 0.1, 0.02, 0.03, 0.01, 0.05, 1e-4, 0.05


@dataclass(frozen=True)
class Hidden:
    """Of A axes, 2 arms, C channels, R ranges: offsets, backlash (A,), tilts, eccentric, phases (A, 2), beams (2, 2),
    lie (2,) in radians; misses (2, 3) and height in arm lengths; gain (C,), ratios (R,); drift a second; dark at the
    warmest, of the nominal one."""

    offsets: Array
    tilts: Array
    backlash: Array
    eccentric: Array
    phases: Array
    misses: Array
    lie: Array
    height: float
    beams: Array
    beam_width: float
    gain: Array
    ratios: Array
    nonlinearity: float
    drift: float
    dark: float
    stray: float
    polarisation: float

    @classmethod
    def of(cls, world: World, config: RigConfig, channels: int) -> "Hidden":
        """What the YAML says; what it leaves open is drawn by its seed, and 0 without one. Raises ConfigError."""
        names, ranges = config.axis_names, config.photodiode.ranges
        if world.gain is not None and len(world.gain) not in (1, channels):
            raise ConfigError(f"world.gain: {len(world.gain)} factors for {channels} channels; give one, or one each")
        rng = None if world.seed is None else generator(world.seed, WORLD, 0)

        def one(said, width: float, *shape: int, low: float = -1.0) -> Array:
            # drawn in any case, so that a key given changes no other
            found = np.zeros(shape) if rng is None else width * rng.uniform(low, 1, shape)
            return found if said is None else np.broadcast_to(np.array(said, float), shape)

        def each(said, keys: tuple[str, ...], width: float, *shape: int, low: float = -1.0) -> Array:
            found = one(None, width, len(keys), *shape, low=low)
            return found if said is None else np.array([said.get(k, np.zeros(shape)) for k in keys], float)

        w = world
        return cls(
            np.radians(each(w.offsets_deg, names, OFFSET)),
            np.radians(each(w.tilts_deg, names, TILT, 2)),
            np.radians(each(w.backlash_deg, names, BACKLASH, low=0)),
            np.radians(each(w.eccentricity_deg, names, ECCENTRIC, 2, low=0)),
            2 * np.pi * one(None, 0.5, len(names), 2),
            each(w.axes_miss_mm, ARMS, MISS, 3) / w.arm_mm,
            np.radians(one(w.sample_tilt_deg, TILT, 2)),
            float(one(w.sample_height_mm, MISS)) / w.arm_mm,
            np.radians(each(w.beam_deg, ARMS, BEAM, 2)),
            float(np.radians(w.beam_width_deg)),
            1 + one(less_one(w.gain), GAIN, channels),
            np.append(1.0, 1 + one(less_one(w.range_ratios), RATIO, ranges - 1)),
            float(one(w.nonlinearity, NONLINEAR)),
            float(one(w.drift_per_h, DRIFT)) / 3600,
            float(one(w.dark_per_k, DARK)) * w.room_k,
            float(one(w.stray, STRAY, low=0)),
            float(one(w.polarisation, POLARISED, low=0)),
        )


class TrueRig:
    """What a rig with a `world` really shows. Raises ValueError where it has none."""

    def __init__(self, config: RigConfig, channels: int):
        if config.world is None:
            raise ValueError(f"rig {config.name}: has no world")
        self.hidden = h = Hidden.of(config.world, config, channels)
        self._kinematics = kinematics_of(config, self.geometry(config))
        self.backlash = backlash_of(config, self.geometry(config))
        self.through = float(np.exp(-np.sum(h.beams**2) / (2 * h.beam_width**2)))

    def geometry(self, config: RigConfig) -> GeometryCalibration:
        """What a perfect calibration would find."""
        h, names = self.hidden, config.axis_names
        nominal = chain_of(config).axes
        waves = np.degrees(h.eccentric[..., None] * np.stack([np.cos(h.phases), np.sin(h.phases)], -1))
        return GeometryCalibration(
            id="-",
            date=dt.datetime(2000, 1, 1, tzinfo=dt.UTC),
            rig=config.name,
            offsets_deg=dict(zip(names, np.degrees(h.offsets).tolist())),
            axes={n: tuple(tilted_axis(nominal[n], tilt).tolist()) for n, tilt in zip(names, h.tilts) if tilt.any()},
            eccentricity_deg={n: tuple(w.ravel().tolist()) for n, w in zip(names, waves) if w.any()},
            backlash_deg=dict(zip(names, np.degrees(h.backlash).tolist())),
            centres={arm: tuple(miss.tolist()) for arm, miss in zip(ARMS, h.misses) if miss.any()},
            height=h.height,
            lie_deg=tuple(np.degrees(h.lie).tolist()),
        )

    def seen(self, pose: Array) -> tuple[Array, Array, float]:
        """wi, wo (3,) in the sample's own frame, and the share of light that comes through, at the angles (A,) in
        radians that encoders without backlash would show."""
        wi, wo = self._kinematics.forward(pose)
        return wi, wo, self.through * self._polarised(wi, wo)

    def signal(self, light: Array, now: float, power: float) -> Array:
        """What reaches the detector (C,) of the light that the sample sends, at a time in s and the lamp's power."""
        h = self.hidden
        return h.gain * (1 + h.drift * now) * (light + h.stray * power)

    def dark(self, nominal: float, now: float) -> float:
        """The dark signal beside the nominal one, at a time in seconds."""
        return nominal * self.hidden.dark * float(np.sin(2 * np.pi * now / ROOM_S))

    def converted(self, signal: Array, ranges: Array, full: Array) -> Array:
        """What the amplifier makes of a signal (C,) on its ranges (C,), whose full scales are `full`."""
        return self.hidden.ratios[ranges] * signal * (1 + self.hidden.nonlinearity * signal / full)

    def _polarised(self, wi: Array, wo: Array) -> float:
        lengths = np.hypot(wi[0], wi[1]), np.hypot(wo[0], wo[1])
        if min(lengths) < 1e-9:  # along the normal no direction lies across
            return 1.0
        c = (wi[0] * wo[0] + wi[1] * wo[1]) / (lengths[0] * lengths[1])
        return 1 + self.hidden.polarisation**2 * float(2 * c * c - 1)


def less_one(factors: tuple[float, ...] | None) -> Array | None:
    return None if factors is None else np.array(factors) - 1


def tilted_axis(axis: Array, tilt: Array) -> Array:
    """The axis (3,), unit, turned by two small angles, rad, about two directions across it."""
    a = unit(np.asarray(axis, float))
    b = unit(np.cross(a, np.eye(3)[np.argmin(np.abs(a))]))
    return turn(tilt[0] * b + tilt[1] * np.cross(a, b)) @ a


def turn(vector: Array) -> Array:
    """Rotation (3, 3) about a vector, by its length in radians (Rodrigues)."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(vector).as_matrix()
