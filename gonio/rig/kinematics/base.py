"""Poses of a rig <-> directions in the sample's frame, in closed form.

A pose is (A,) radians in the order of `names`; directions are unit vectors with z = the sample's normal. `inverse`
gives every pose (branch) that shows a pair, regardless of limits; angles are in (-pi, pi] and the caller adds turns.

At a pole (light or detector on the normal) one angle means nothing: it keeps the value it has in `near`.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array


class Kinematics(Protocol):
    """One geometry of rig. `arms` (A,) marks the axes that change the angle between the two arms."""

    @property
    def names(self) -> tuple[str, ...]: ...

    @property
    def arms(self) -> NDArray[np.bool_]: ...

    def forward(self, pose: Array) -> tuple[Array, Array]:
        """(wi, wo), each (..., 3), of poses (..., A)."""
        ...

    def inverse(self, wi: Array, wo: Array, near: Array) -> Array:
        """(N, B, A) poses that show (wi, wo), each (N, 3); near (A,) decides what is free. NaN = no such branch."""
        ...

    def inverse_isotropic(self, wi: Array, wo: Array, near: Array) -> Array:
        """As `inverse`, of the pair turned about the normal to where `near` has the sample, and of its mirror image."""
        ...
