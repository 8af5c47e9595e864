"""Drives a stage to a pose by a way that is clear: round the stay-out cone, from below where there is backlash."""

import threading

import numpy as np

from gonio.geometry import Array
from gonio.rig.devices import Stage
from gonio.rig.errors import SafetyStop
from gonio.rig.motion.approach import Approach
from gonio.rig.motion.envelope import Envelope
from gonio.rig.motion.plan import Planner
from gonio.rig.motion.profile import move_time

ROUTES = 5  # tried to one pose, where servos stop short of the waypoints of those before


class Driver:
    """Of the rig `name`. stopped: set from any thread, it ends a way early."""

    def __init__(
        self,
        name: str,
        stage: Stage,
        envelope: Envelope,
        approach: Approach,
        planner: Planner,
        stopped: threading.Event,
    ):
        self.name, self.stage, self.envelope, self.approach, self.planner = name, stage, envelope, approach, planner
        self.stopped = stopped

    def go(self, pose: Array, straight_from: Array | None = None) -> Array | None:
        """Drive to a pose by a way that is clear; the pose achieved, None where there is no way.

        straight_from: a pose from where the straight way is known to be clear. Ends early when stopped. Raises
        SafetyStop, DeviceFault.
        """
        if not self.stage.homed:
            raise SafetyStop(f"rig {self.name}: not homed; run `gonio home` before anything moves")
        at = self.stage.pose()
        known = straight_from is not None and np.array_equal(at, straight_from)
        for _ in range(ROUTES):
            legs = self.approach.legs(at, pose, self.seconds, straight=known)
            if legs is None:
                return None
            known = False
            for k, leg in enumerate(legs):
                if self.stopped.is_set():
                    return at
                if not self.envelope.inside(leg):
                    raise SafetyStop(f"rig {self.name}: a pose outside the limits was asked for; not driven there")
                if k and not self._still_clear(at, legs[k - 1], leg):
                    break
                at = self.stage.move(leg, 2.0 + 1.5 * float(self.seconds(leg - at)))
            else:
                return at
        return None

    def _still_clear(self, at: Array, planned: Array, leg: Array) -> bool:
        """Whether a leg planned from one pose is clear from where the servos came to rest instead."""
        return np.array_equal(at, planned) or bool(self.envelope.path_clear(at[None], leg[None])[0])

    def seconds(self, delta: Array) -> Array:
        return move_time(delta, self.planner.velocity, self.planner.acceleration)
