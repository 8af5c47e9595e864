"""The last bit of a move: round the stay-out cone, and from below on axes whose backlash would show."""

from collections.abc import Callable
from typing import Literal

import numpy as np

from gonio.geometry import Array
from gonio.rig.motion.envelope import Envelope
from gonio.rig.motion.route import route


class Approach:
    """Legs from one pose to the next. backlash (A,) in rad; isotropic: turning the sample alone changes nothing."""

    def __init__(
        self, envelope: Envelope, backlash: Array, one_sided: Literal["never", "needed", "always"], isotropic: bool
    ):
        self.envelope, self.one_sided, self.isotropic = envelope, one_sided, isotropic
        self.backlash = np.zeros_like(backlash) if one_sided == "never" else backlash
        # far enough below that the play is taken up on the way back, on the encoder's grid
        step = envelope.resolution
        room = np.where(self.backlash > 0, 1.5 * self.backlash + 2 * step, 0.0)
        self._room = np.where(step > 0, np.ceil(room / np.where(step > 0, step, 1)) * step, room)

    def legs(
        self, start: Array, end: Array, seconds: Callable[[Array], Array], *, straight: bool = False
    ) -> Array | None:
        """Poses (K, A) to drive through, `end` last, all inside the limits and clear of the cone; None = no way.

        straight: the straight way is known to be clear.
        """
        way = end[None] if straight else route(self.envelope, start, end, seconds)
        if way is None or not self.backlash.any():
            return way
        matters = self._matters(end) if self.one_sided == "needed" else self.backlash > 0
        low = np.zeros(len(end), bool)
        for _ in range(len(end) + 1):  # a way round the cone to a point below may bring other axes down
            more = ~low & matters & self._from_above(start, way)
            more &= end - self._room >= self.envelope.lower  # no room: the lower limit is met from above
            if not more.any():
                return way
            low |= more
            below = np.where(low, end - self._room, end)
            to_below = route(self.envelope, start, below, seconds)
            if to_below is None or not self.envelope.path_clear(below[None], end[None])[0]:
                return way  # better with its backlash than not at all
            way = np.concatenate([to_below, end[None]])
        return way

    def _from_above(self, start: Array, way: Array) -> np.ndarray:
        """Which axes (A,) come down in the last leg that moves them at all."""
        legs = np.diff(np.concatenate([start[None], way]), axis=0)
        down = np.zeros(len(start), bool)
        for leg in legs:
            down = np.where(np.abs(leg) > 1e-9, leg < 0, down)
        return down

    def _matters(self, end: Array) -> np.ndarray:
        """On which axes the backlash would turn a direction by more than half a count (1e-4 rad without counts)."""
        least = np.where(self.envelope.resolution > 0, self.envelope.resolution / 2, 1e-4)
        forward = self.envelope.kinematics.forward
        poses = end + np.diag(self.backlash)
        wi, wo = forward(poses)
        here_i, here_o = forward(end)
        if self.isotropic:
            wi, wo = _turned(wi, wo, here_i, here_o)
        return np.maximum(np.linalg.norm(wi - here_i, axis=-1), np.linalg.norm(wo - here_o, axis=-1)) > least


def _turned(wi: Array, wo: Array, to_i: Array, to_o: Array) -> tuple[Array, Array]:
    """Pairs (M, 3), (M, 3), each turned about the normal to be as near as can be to one pair (3,), (3,).

    The cosines of its angles do not tell: where an arm leaves the plane of incidence they stand still to first order,
    and the half vector does not.
    """
    dot = wi[:, :2] @ to_i[:2] + wo[:, :2] @ to_o[:2]
    cross = wi[:, 0] * to_i[1] - wi[:, 1] * to_i[0] + wo[:, 0] * to_o[1] - wo[:, 1] * to_o[0]
    angle = np.arctan2(cross, dot)
    c, s = np.cos(angle), np.sin(angle)
    turn = lambda w: np.stack([c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1], w[:, 2]], -1)
    return turn(wi), turn(wo)
