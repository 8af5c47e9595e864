"""Encoders that do not show 0 where the joint is at 0, and that turn eccentrically.

joint = e - s1 sin e - c1 cos e - s2 sin 2e - c2 cos 2e,   e = encoder - offset
"""

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.rig.kinematics.base import Kinematics

ROUNDS = 60  # of the fixed point; each gains as many digits as the harmonics are small


class Encoders:
    """A kinematics in the encoders' angles. offset (A,) rad; eccentric (A, 4) rad: s1, c1, s2, c2, each well below
    1."""

    def __init__(self, joints: Kinematics, offset: Array, eccentric: Array | None = None):
        self.joints, self.offset = joints, offset
        self._eccentric = None if eccentric is None or not np.any(eccentric) else np.asarray(eccentric, float)

    @property
    def names(self) -> tuple[str, ...]:
        return self.joints.names

    @property
    def arms(self) -> NDArray[np.bool_]:
        return self.joints.arms

    def joint(self, pose: Array) -> Array:
        """Where the joints are (..., A) when the encoders show `pose`."""
        e = np.asarray(pose, float) - self.offset
        return e if self._eccentric is None else e - self._wobble(e)

    def encoder(self, joint: Array) -> Array:
        """What the encoders show (..., A), as many turns away from 0 as the joints are. NaN stays NaN."""
        if self._eccentric is None:
            return joint + self.offset
        e = joint
        for _ in range(ROUNDS):
            last, e = e, joint + self._wobble(e)
            if not np.nanmax(np.abs(e - last), initial=0.0) > 1e-15:
                break
        return e + self.offset

    def forward(self, pose: Array) -> tuple[Array, Array]:
        return self.joints.forward(self.joint(pose))

    def inverse(self, wi: Array, wo: Array, near: Array) -> Array:
        return self._shown(self.joints.inverse(wi, wo, self.joint(near)), near)

    def inverse_isotropic(self, wi: Array, wo: Array, near: Array) -> Array:
        return self._shown(self.joints.inverse_isotropic(wi, wo, self.joint(near)), near)

    def _wobble(self, e: Array) -> Array:
        assert self._eccentric is not None
        s1, c1, s2, c2 = self._eccentric.T
        return s1 * np.sin(e) + c1 * np.cos(e) + s2 * np.sin(2 * e) + c2 * np.cos(2 * e)

    def _shown(self, poses: Array, near: Array) -> Array:
        """Encoder angles within half a turn of 0, except where a free angle stays at `near`'s."""
        shown = self.encoder(poses)
        kept = np.abs(shown - near) < 1e-12
        return np.where(kept, near, shown - 2 * np.pi * np.rint(shown / (2 * np.pi)))
