"""The numbers in which a rig may differ from its drawing, as one vector; in radians and arm lengths.

Weak priors, Gaussian about the drawing, hold what no observation tells: the turntable's zero under a mirror, or an
encoder's first harmonic beside the shift of its arm's centre, which turn an arm alike.
"""

import datetime as dt

import numpy as np

from gonio.config.rig import RigConfig
from gonio.geometry import Array, unit
from gonio.rig.build import chain_of, kinematics_of
from gonio.rig.calibration import GeometryCalibration
from gonio.rig.kinematics.base import Kinematics
from gonio.rig.signal.view import rotation_of

PRIOR = {
    "offset": np.radians(10.0),
    "tilt": np.radians(2.0),
    "turn": np.radians(0.2),
    "backlash": np.radians(0.3),
    "centre": 0.003,  # of an arm: 1.2 mm at 400 mm
    "height": 0.003,
    "lie": np.radians(2.0),
    "mirror": np.radians(5.0),
}
HELD = 1e-9
WAVES = ("s1", "c1", "s2", "c2")
ARMS = ("light", "detector")


class Parameters:
    """Names, priors and meaning of a vector p (P,) for one rig and mirrors that do not lie as the sample does.

    mirrors: normals (3,) of the latter in the sample's frame, about as expected; each has two parameters. held: kinds
    of parameters that are taken to be as drawn.
    """

    def __init__(self, config: RigConfig, mirrors: tuple[Array, ...] = (), held: tuple[str, ...] = ()):
        self.config, self.mirrors = config, mirrors
        axes = config.axis_names
        self.nominal = {n: unit(a) for n, a in chain_of(config).axes.items()}
        self._across = {n: across(a) for n, a in self.nominal.items()}
        self.names = (
            *(f"offset.{a}" for a in axes),
            *(f"tilt.{a}.{k}" for a in axes for k in (1, 2)),
            *(f"turn.{a}.{w}" for a in axes for w in WAVES),
            *(f"backlash.{a}" for a in axes),
            *(f"centre.{arm}.{k}" for arm in ARMS for k in "xyz"),
            "height",
            "lie.x",
            "lie.y",
            *(f"mirror{j}.{k}" for j in range(1, len(mirrors) + 1) for k in "xy"),
        )
        # what is seen is the whole lag; a calibration says what it is beyond the axis's own
        self._own_lag_deg = np.array([config.axes[a].backlash_deg for a in axes])
        first = [name.split(".")[0] for name in self.names]
        self._places = {kind: np.flatnonzero(np.array(first) == kind) for kind in first}
        kinds = [name.split(".")[0].rstrip("0123456789") for name in self.names]
        self.prior = np.array([HELD if kind in held else PRIOR[kind] for kind in kinds])
        if "backlash" not in held:
            self.prior[self._places["backlash"]] += np.radians(self._own_lag_deg)

    def __len__(self) -> int:
        return len(self.names)

    def of(self, p: Array, kind: str) -> Array:
        """The part of p whose names begin with `kind`."""
        return np.asarray(p[self._places[kind]])

    def fields(self, p: Array) -> dict:
        """What p means in a geometry calibration."""
        axes = self.config.axis_names
        tilts, waves = self.of(p, "tilt").reshape(-1, 2), np.degrees(self.of(p, "turn")).reshape(-1, 4)
        return {
            "offsets_deg": dict(zip(axes, np.degrees(self.of(p, "offset")).tolist())),
            "axes": {n: tuple(unit(self.nominal[n] + t @ self._across[n]).tolist()) for n, t in zip(axes, tilts)},
            "eccentricity_deg": {n: tuple(w.tolist()) for n, w in zip(axes, waves)},
            "backlash_deg": dict(zip(axes, (np.degrees(self.of(p, "backlash")) - self._own_lag_deg).tolist())),
            "centres": {arm: tuple(c.tolist()) for arm, c in zip(ARMS, self.of(p, "centre").reshape(2, 3))},
            "height": float(self.of(p, "height")[0]),
            "lie_deg": tuple(np.degrees(self.of(p, "lie")).tolist()),
        }

    def kinematics(self, p: Array) -> Kinematics:
        """The rig as p says, in its encoders' angles."""
        at = dt.datetime(2000, 1, 1, tzinfo=dt.UTC)
        return kinematics_of(self.config, GeometryCalibration(id="-", date=at, rig="-", **self.fields(p)))

    def normal(self, p: Array, mirror: int) -> Array:
        """Normal (3,) of a mirror in the sample's frame; mirror 0 lies as the sample does."""
        if mirror == 0:
            return np.array([0.0, 0.0, 1.0])
        return rotation_of(np.array([*self.of(p, f"mirror{mirror}"), 0.0])) @ self.mirrors[mirror - 1]

    def inverse_of(self, geometry: GeometryCalibration) -> Array:
        """The vector (P,) that a calibration's fields stand for; mirrors as expected."""
        axes, p = self.config.axis_names, []
        p += np.radians([geometry.offsets_deg.get(a, 0.0) for a in axes]).tolist()
        for a in axes:
            n = unit(np.array(geometry.axes.get(a, self.nominal[a]), float))
            p += (self._across[a] @ n / (self.nominal[a] @ n)).tolist()
        p += np.radians([geometry.eccentricity_deg.get(a, (0.0,) * 4) for a in axes]).ravel().tolist()
        p += np.radians(self._own_lag_deg + [geometry.backlash_deg.get(a, 0.0) for a in axes]).tolist()
        p += np.ravel([geometry.centres.get("light", (0,) * 3), geometry.centres.get("detector", (0,) * 3)]).tolist()
        p += [geometry.height, *np.radians(geometry.lie_deg).tolist(), *[0.0] * 2 * len(self.mirrors)]
        return np.array(p)


def across(axis: Array) -> Array:
    """Two unit vectors (2, 3) at right angles to a unit vector and to each other."""
    a = np.cross(axis, np.eye(3)[int(np.abs(axis).argmin())])
    a = unit(a)
    return np.stack([a, np.cross(axis, a)])
