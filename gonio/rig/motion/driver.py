"""Drives a stage to a pose by a way that is clear: round the stay-out cone, from below where there is backlash."""

import threading
from typing import Any

import numpy as np

from gonio.geometry import Array
from gonio.rig.devices import Stage
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.rig.motion.approach import Approach
from gonio.rig.motion.envelope import Envelope
from gonio.rig.motion.plan import Planner
from gonio.rig.motion.profile import move_time

ASTRAY = np.radians(5.0)  # a servo may stop so much short, or this many of its counts; farther off, something is wrong
ASTRAY_COUNTS = 10
REMEDY = "check its encoder and its driver, free the joint, then `gonio home`"
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
        at = self._shown(self.stage.pose())
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
                at = self._shown(self.stage.move(leg, 2.0 + 1.5 * float(self.seconds(leg - at))))
                if not self.stopped.is_set():
                    self._refuse_astray(at, leg)
            else:
                return at
        return None

    def _still_clear(self, at: Array, planned: Array, leg: Array) -> bool:
        """Whether a leg planned from one pose is clear from where the servos came to rest instead."""
        return np.array_equal(at, planned) or bool(self.envelope.path_clear(at[None], leg[None])[0])

    def _shown(self, pose: Any) -> Array:
        """What the stage says of its pose, if that is one. Raises DeviceFault."""
        try:
            at = np.asarray(pose, float)
        except (TypeError, ValueError):
            at = np.array(np.nan)
        if at.shape != (len(self.envelope.axes),):
            raise DeviceFault("stage", f"shows no pose of {len(self.envelope.axes)} axes: {str(pose)[:80]!r}", REMEDY)
        if not np.isfinite(at).all():
            name = self.envelope.axes[int(np.isfinite(at).argmin())].name
            raise DeviceFault(f"stage, {name}", f"shows {at[~np.isfinite(at)][0]} in place of an angle", REMEDY)
        return at

    def _refuse_astray(self, at: Array, asked: Array) -> None:
        """Raises DeviceFault where a stage came to rest too far from the pose asked for to go on by a plan."""
        off = np.abs(at - asked)
        beyond = off - np.maximum(ASTRAY, ASTRAY_COUNTS * self.envelope.resolution)
        worst = int(beyond.argmax())
        if beyond[worst] > 1e-6:
            far = f"is {np.degrees(off[worst]):.1f} degrees off the pose asked for"
            raise DeviceFault(f"stage, {self.envelope.axes[worst].name}", far, REMEDY)

    def seconds(self, delta: Array) -> Array:
        return move_time(delta, self.planner.velocity, self.planner.acceleration)
