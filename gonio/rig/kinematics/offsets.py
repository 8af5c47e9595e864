"""Encoders that do not show 0 where the joint is at 0."""

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.rig.kinematics.base import Kinematics


class Offsets:
    """A kinematics in the encoders' angles: encoder = joint + offset (A,) rad."""

    def __init__(self, joints: Kinematics, offset: Array):
        self.joints, self.offset = joints, offset

    @property
    def names(self) -> tuple[str, ...]:
        return self.joints.names

    @property
    def arms(self) -> NDArray[np.bool_]:
        return self.joints.arms

    def forward(self, pose: Array) -> tuple[Array, Array]:
        return self.joints.forward(pose - self.offset)

    def inverse(self, wi: Array, wo: Array, near: Array) -> Array:
        return self._shown(self.joints.inverse(wi, wo, near - self.offset), near)

    def inverse_isotropic(self, wi: Array, wo: Array, near: Array) -> Array:
        return self._shown(self.joints.inverse_isotropic(wi, wo, near - self.offset), near)

    def _shown(self, poses: Array, near: Array) -> Array:
        """Encoder angles within half a turn of 0, except where a free angle stays at `near`'s."""
        shown = poses + self.offset
        kept = np.abs(shown - near) < 1e-12
        return np.where(kept, near, shown - 2 * np.pi * np.rint(shown / (2 * np.pi)))
