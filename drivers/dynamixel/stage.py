"""A stage made of Dynamixel servos.

    goals by one sync write -> read back -> one sync read per poll until every servo stands -> where did it stop?

The deadline of a move runs from the moment the servos are known to have their goals. Nothing is believed that was not
read back. A host that dies is noticed by the servos' own watchdogs.
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np

from drivers.dynamixel import tables as t
from drivers.dynamixel.bus import Bus, NoAnswer, Refused
from drivers.dynamixel.configure import Joint, hardware_fault
from drivers.dynamixel.poll import State
from drivers.dynamixel.servos import Servos
from drivers.gone import PortGone, outlast
from gonio.geometry import Array
from gonio.rig.clock import Clock
from gonio.rig.devices import Axis
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.rig.motion.profile import move_time

T = TypeVar("T")

COUNT = 2 * np.pi / t.COUNTS
ARRIVED = 1  # counts off the goal that still are the goal
SHORT = np.radians(5.0)  # farther off than this, something is wrong
GRACE_S = 5.0  # how long a port may be away in the middle of a move
EARLY = 16  # counts: shorter ways are not judged by their time


class DynamixelStage:
    """Implements `gonio.rig.devices.Stage`.

    Call `connect` first. clock is that of the rig; poll_s its seconds between two polls, well below watchdog_s.
    """

    def __init__(
        self,
        bus: Bus,
        axes: tuple[Axis, ...],
        ids: Mapping[str, int],
        model: str,
        park: Array,
        clock: Clock,
        *,
        watchdog_s: float = 0.5,
        after_fault: str = "hold",
        poll_s: float = 0.02,
        grace_s: float = GRACE_S,
    ):
        self.bus, self._axes, self.model, self._park, self.clock = bus, axes, model, park, clock
        self.watchdog_s, self.after_fault, self.poll_s, self.grace_s = watchdog_s, after_fault, poll_s, grace_s
        self.velocity = np.array([a.velocity for a in axes])
        self.acceleration = np.array([a.acceleration for a in axes])
        self.joints = tuple(joint_of(a, ids[a.name]) for a in axes)
        self.ids = [j.id for j in self.joints]
        self.servos = Servos(bus, self.joints, model, watchdog_s)
        self.homed = False
        self._stopped = threading.Event()
        self._moving = False
        self._rest: tuple[float, list[State]] | None = None  # when the servos were last seen, all at rest

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self._axes

    # ---- coming up and going down ----------------------------------------------------------------------------------

    def connect(self) -> None:
        """Open the port, recognise and configure every servo. Raises DeviceFault. Moves nothing."""
        try:
            self.bus.open()
            self._outlast(self.servos.configure, self.bus.reopen)
        except PortGone as e:
            self.bus.close()
            raise self._gone(e) from None
        except BaseException:
            self.bus.close()
            raise

    def home(self) -> None:
        """The encoders are absolute: confirmed where every servo is well and shows a position inside its limits."""
        for joint, state in zip(self.joints, self._outlast(self.states)):
            if fault := hardware_fault(joint.name, state.hardware):
                raise fault
            if not joint.lower - ARRIVED <= state.position <= joint.upper + ARRIVED:
                raise DeviceFault(
                    joint.name,
                    f"stands at {np.degrees(angle(state.position)):.1f} degrees, outside its limits",
                    "move it inside by hand with the power off",
                )
        self.homed = True

    def reboot(self, name: str) -> None:
        """At the operator's command only. Raises DeviceFault."""
        self._outlast(lambda: self.servos.reboot(name))

    def close(self) -> None:
        """Servos at rest, then the port let go. Never raises."""
        try:
            if self.bus.port.is_open and (self._moving or self._stopped.is_set()):
                self.stop()
        except (DeviceFault, OSError):
            pass
        finally:
            self.bus.close()

    # ---- moving ----------------------------------------------------------------------------------------------------

    def move(self, pose: Array, deadline: float) -> Array:
        """Raises DeviceFault, naming joint, cause and remedy; SafetyStop for a pose outside the limits."""
        goals = self._counts(np.asarray(pose, float))
        if self._stopped.is_set():
            return self.pose()
        self._moving = True
        try:
            at = self._outlast(lambda: self._move(goals, deadline))
            self._moving = False
            return at
        except DeviceFault:
            self._make_safe()
            raise

    def _move(self, goals: dict[int, int], deadline: float) -> Array:
        present = self._lately() or self.states()
        self._rest = None
        sent = self.clock.now()
        way = np.array([goals[i] - s.position for i, s in zip(self.ids, present)]) * COUNT
        state = self.servos.start(goals, self._profile(way), present, self._stopped)
        begun = self.clock.now()
        seconds = float(move_time(way, self.velocity, self.acceleration))
        ready = begun + seconds
        still, late = 0, False
        while not self._stopped.is_set():
            self.servos.check(state, goals)
            off = np.array([abs(goals[i] - s.position) for i, s in zip(self.ids, state)])
            moving = np.array([s.moving for s in state])
            if self.clock.now() - sent < 0.5 * seconds:
                self._believe(np.abs(way), off)
            if not moving.any() and (off <= ARRIVED).all():
                self._rest = time.monotonic(), state
                return self._pose(state)
            still = still + 1 if not moving.any() and self.clock.now() >= ready else 0
            if still >= 3 or (late and not moving.any()):  # they stand, but not where they should
                return self._short(state, off)
            if late:
                name = self.joints[int((off + 1e6 * moving).argmax())].name
                raise DeviceFault(
                    name, f"not there after {deadline:.1f} s", "is it blocked? free it, then `gonio home`"
                )
            self.clock.sleep(min(max(ready - self.clock.now(), 0.1 * self.poll_s), self.poll_s))
            late = self.clock.now() > begun + deadline  # and a poll after that is to say so
            state = self.states()
        self._halt()
        return self.pose()

    def _profile(self, way: Array) -> bytes:
        """One ramp and one time for all axes: they start and stop together, so the way is a straight line."""
        way = np.abs(way)
        cruise, ramp = float((way / self.velocity).max()), float((way / self.acceleration).max())
        time_ms = max(int(np.ceil(1000 * float(move_time(way, self.velocity, self.acceleration)))), 2)
        ramp_ms = min(int(np.ceil(1000 * ramp / cruise)), time_ms // 2) if cruise > 0 else 1
        return ramp_ms.to_bytes(4, "little") + time_ms.to_bytes(4, "little")

    def _believe(self, way: Array, off: Array) -> None:
        """In less than half of its time no servo is there. Raises DeviceFault."""
        early = (way > EARLY * COUNT) & (off <= ARRIVED)
        if early.any():
            name = self.joints[int(early.argmax())].name
            raise DeviceFault(
                name, "shows a position that it cannot have reached", "check its encoder and its coupling"
            )

    def _short(self, state: Sequence[State], off: Array) -> Array:
        if off.max() * COUNT > SHORT:
            name = self.joints[int(off.argmax())].name
            degrees = np.degrees(off.max() * COUNT)
            raise DeviceFault(name, f"stopped {degrees:.1f} degrees short", "free the joint, then `gonio home`")
        return self._pose(state)

    # ---- stopping --------------------------------------------------------------------------------------------------

    def stop(self) -> None:
        """The servos hold where they are when this returns. Raises DeviceFault where they cannot be reached."""
        self._stopped.set()
        try:
            self._halt()
        except PortGone as e:
            raise self._gone(e) from None  # their watchdogs stop them
        self._moving = False

    def allow(self) -> None:
        self._stopped.clear()

    def _halt(self) -> None:
        self._rest = None
        self.servos.halt()

    def _make_safe(self) -> None:
        """After a fault: torque held where the servos are, or released, as the rig's config says. Never raises."""
        self._moving = False
        try:
            if self.after_fault == "release":
                self.servos.release()
            else:
                self._halt()
        except (DeviceFault, Refused, NoAnswer, OSError):
            pass

    # ---- where it is -----------------------------------------------------------------------------------------------

    def states(self) -> list[State]:
        """What every servo says of itself. Raises DeviceFault, PortGone."""
        return self.servos.states()

    def _lately(self) -> list[State] | None:
        """The servos as last seen, if they were at rest and that was so lately that no watchdog has tripped since."""
        rest = self._rest
        return rest[1] if rest and time.monotonic() - rest[0] < self.watchdog_s / 4 else None

    def pose(self) -> Array:
        return self._pose(self._lately() or self._outlast(self.states))

    def park(self) -> None:
        pose = self.pose()
        self.move(self._park, 2 + 1.5 * float(move_time(self._park - pose, self.velocity, self.acceleration)))

    def _pose(self, state: Sequence[State]) -> Array:
        return np.array([angle(s.position) for s in state])

    def _counts(self, pose: Array) -> dict[int, int]:
        counts = {}
        for joint, a in zip(self.joints, pose.tolist()):
            n = t.ZERO + round(a / COUNT) if np.isfinite(a) else -1
            if not joint.lower <= n <= joint.upper:
                raise SafetyStop(f"{joint.name}: {np.degrees(a):.3f} degrees lies outside its limits; not driven there")
            counts[joint.id] = n
        return counts

    def _outlast(self, act: Callable[[], T], bring_back: Callable[[], None] | None = None) -> T:
        """`act`, through absences of the port that last no longer than the grace time. Raises DeviceFault."""
        try:
            return outlast(act, bring_back or self._bring_back, self.grace_s)
        except PortGone as e:
            raise self._gone(e) from None

    def _bring_back(self) -> None:
        """The port open again and every servo configured: its supply may have gone with it."""
        self.bus.reopen()
        self.servos.configure()

    def _gone(self, e: PortGone) -> DeviceFault:
        name = self.bus.port.port_name
        if e.taken:
            return DeviceFault("stage", f"{name} is in use by another program", "stop it; one program drives a rig")
        return DeviceFault("stage", f"{name} is gone", "plug in its USB cable and power, then `gonio resume`")


def joint_of(axis: Axis, servo: int) -> Joint:
    """Limits as the outermost counts inside them. Raises DeviceFault where the encoder has not so many."""
    lower, upper = t.ZERO + np.ceil(axis.lower / COUNT - 1e-9), t.ZERO + np.floor(axis.upper / COUNT + 1e-9)
    if lower < 0 or upper > t.COUNTS - 1:
        raise DeviceFault(
            axis.name,
            f"limits of {np.degrees(axis.lower):g} to {np.degrees(axis.upper):g} degrees are more than one turn has",
            "keep within lower_deg -180 and upper_deg 179.9",
        )
    v = t.units(1.1 * np.degrees(axis.velocity), t.VELOCITY_UNIT_DEG_S)
    return Joint(axis.name, servo, int(lower), int(upper), v)


def angle(counts: int) -> float:
    return (counts - t.ZERO) * COUNT
