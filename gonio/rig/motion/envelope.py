"""Where the rig may be: axis limits, and a stay-out cone around retro-reflection where one arm shades the other.

What may be measured is decided here before sampling, so that it is the support of the chain's target; a motion is
checked along its whole path.
"""

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.rig.devices import Axis
from gonio.rig.kinematics.base import Kinematics
from gonio.rig.kinematics.gantry import Gantry

TOLERANCE = np.radians(0.02)  # nearer to the cone than this is in it
MAX_STEPS = 400  # along a path; whoever creeps along the cone for longer had better go round


class Envelope:
    """Limits of `axes` and the stay-out half-angle (rad) of a rig with the given kinematics."""

    def __init__(self, kinematics: Kinematics, axes: tuple[Axis, ...], stay_out: float):
        self.kinematics, self.axes, self.stay_out = kinematics, axes, stay_out
        self.resolution = np.array([a.resolution for a in axes])
        slack = np.where(self.resolution > 0, 1e-9, 1e-12)  # an asked 90.000000000001 degrees is 90
        lower, upper = np.array([a.lower for a in axes]), np.array([a.upper for a in axes])
        grid = np.where(self.resolution > 0, self.resolution, 1.0)
        on_grid = self.resolution > 0
        self._counts = bool(on_grid.any())
        # the outermost counts inside the limits
        self.lower = np.where(on_grid, np.ceil(lower / grid - 1e-9) * grid, lower)
        self.upper = np.where(on_grid, np.floor(upper / grid + 1e-9) * grid, upper)
        self._low, self._high = self.lower - slack, self.upper + slack
        # rounding to counts moves each arm by half a count at most, a path check leaves its tolerance
        snap = 0.5 * float(self.resolution[kinematics.arms].sum())
        self.margin = snap + 2 * TOLERANCE if stay_out > 0 else 0.0
        self._horizon = np.sin(float(self.resolution.max()) / 2)  # half a count lower is not rounded onto the horizon
        turns = np.floor((upper - lower) / (2 * np.pi) + 1e-9).astype(int)
        self._whole = self._all_of_it()
        full = upper - lower > 2 * np.pi + 1e-6
        self._turns = np.array(np.meshgrid(*[np.arange(-t - 1, t + 2) if f else [0] for t, f in zip(turns, full)]))
        self._turns = (
            2 * np.pi * self._turns.reshape(len(axes), -1).T
        )  # (W, A), (1, A) where no axis has two ways round

    def snap(self, poses: Array) -> Array:
        """The nearest poses that the encoders can show."""
        if not self._counts:
            return poses
        grid = np.where(self.resolution > 0, self.resolution, 1.0)
        return np.where(self.resolution > 0, np.round(poses / grid) * grid, poses)

    def fit(self, poses: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Poses (N, B, A) snapped to counts, with every way round an axis: (N, B W, A); and which are allowed."""
        if len(self._turns) > 1:
            poses = (poses[:, :, None, :] + self._turns).reshape(len(poses), -1, poses.shape[-1])
        if self._whole and not self._counts and len(self._turns) == 1:
            return poses, np.ones(poses.shape[:2], bool)
        poses = self.snap(poses)
        return poses, self.inside(poses)

    def inside(self, poses: Array) -> NDArray[np.bool_]:
        """Which poses (..., A) lie within the limits of every axis; NaN does not."""
        if poses.size < 256:
            return np.asarray(((poses >= self._low) & (poses <= self._high)).all(-1))
        ok = np.ones(poses.shape[:-1], bool)
        for k in range(len(self.axes)):  # axis by axis: a reduction over a last axis of four is slow
            ok &= (poses[..., k] >= self._low[k]) & (poses[..., k] <= self._high[k])
        return ok

    def separation(self, poses: Array) -> Array:
        """Angle between the arms, rad."""
        return _angle(*self.kinematics.forward(poses))

    def path_clear(self, a: Array, b: Array) -> NDArray[np.bool_]:
        """Which straight moves from a (M, A) to b (M, A) keep the arms apart all the way.

        The angle between the arms changes by no more than their joints turn, so it is safe to step on by as much as is
        left (conservative advancement); closer than TOLERANCE to the cone counts as in it, and so does creeping along.
        """
        clear = np.ones(len(a), bool)
        if self.stay_out == 0:
            return clear
        turn = np.abs((b - a)[:, self.kinematics.arms]).sum(-1)
        t, going = np.zeros(len(a)), np.arange(len(a))
        for _ in range(MAX_STEPS):
            at = t[going]
            left = self.separation(a[going] + at[:, None] * (b - a)[going]) - self.stay_out
            clear[going[left < TOLERANCE]] = False
            go_on = (left >= TOLERANCE) & (at < 1)
            going, left = going[go_on], left[go_on]
            if not len(going):
                return clear
            t[going] = np.minimum(t[going] + left / np.maximum(turn[going], 1e-12), 1)
        clear[going] = False
        return clear

    def reachable(self, wi: Array, wo: Array) -> NDArray[np.bool_]:
        """Which pairs (N, 3), (N, 3) the rig can show: both above the horizon, apart, and within the limits."""
        wi, wo = np.asarray(wi, float), np.asarray(wo, float)
        ok = (wi[:, 2] > self._horizon) & (wo[:, 2] > self._horizon)
        if self.stay_out > 0:
            ok &= ((wi - wo) ** 2).sum(-1) >= (2 * np.sin((self.stay_out + self.margin) / 2)) ** 2
        if self._whole:
            return ok
        near = np.zeros(len(self.axes))
        poses = self.kinematics.inverse(wi, wo, near)
        if len(self._turns) > 1:
            poses = (poses[:, :, None, :] + self._turns).reshape(len(poses), -1, poses.shape[-1])
        return ok & self.inside(poses).any(-1)

    def _all_of_it(self) -> bool:
        """Whether the limits take nothing away, as on an ideal gantry."""
        if not isinstance(self.kinematics, Gantry):
            return False
        need = np.array([np.pi / 2, np.pi, np.pi / 2, np.pi])
        return bool(np.all(self._high >= need) and np.all(self._low <= -need))


def _angle(a: Array, b: Array) -> Array:
    difference, total = a - b, a + b
    return 2 * np.arctan2(np.sqrt((difference * difference).sum(-1)), np.sqrt((total * total).sum(-1)))
