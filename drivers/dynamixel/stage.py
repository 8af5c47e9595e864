"""A stage made of Dynamixel servos.

    goals by one sync write -> read back -> one sync read per poll until every servo stands -> where did it stop?

The deadline of a move runs from the moment the servos are known to have their goals. Nothing is believed that was not
read back. A host that dies is noticed by the servos' own watchdogs.
"""

import threading
import time
from collections.abc import Mapping, Sequence

import numpy as np

from drivers.dynamixel import tables as t
from drivers.dynamixel.bus import Bus, NoAnswer, Refused
from drivers.dynamixel.configure import Joint, configure, hardware_fault, healthy, put, recognise, watchdog_units
from drivers.dynamixel.poll import State, decode
from drivers.gone import PortGone
from gonio.geometry import Array
from gonio.rig.clock import Clock
from gonio.rig.devices import Axis
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.rig.motion import move_time

COUNT = 2 * np.pi / t.COUNTS
ARRIVED = 1  # counts off the goal that still are the goal
SHORT = np.radians(5.0)  # farther off than this, something is wrong
GRACE_S = 5.0  # how long a port may be away in the middle of a move
BRAKE = (20).to_bytes(4, "little") + (40).to_bytes(4, "little")  # ramp and time of a stop, ms
EARLY = 16  # counts: shorter ways are not judged by their time
ATTEMPTS = 3  # at giving the servos their goals


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
            self._configure()
        except PortGone as e:
            self.bus.close()
            raise self._gone(e) from None
        except BaseException:
            self.bus.close()
            raise

    def _configure(self) -> None:
        for joint in self.joints:
            recognise(self.bus, joint, self.model)
            healthy(self.bus, joint)
            configure(self.bus, joint, self.watchdog_s)

    def home(self) -> None:
        """The encoders are absolute: confirmed where every servo is well and shows a position inside its limits."""
        for joint, state in zip(self.joints, self.states()):
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
        """At the operator's command only: all that the servo forgets is written again. The arm may sag meanwhile."""
        joint = next(j for j in self.joints if j.name == name)
        self.bus.reboot(joint.id)
        threading.Event().wait(0.3)  # it is deaf for a while
        recognise(self.bus, joint, self.model)
        healthy(self.bus, joint)
        configure(self.bus, joint, self.watchdog_s)

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
            try:
                at = self._move(goals, deadline)
            except PortGone as e:
                if not self.bus.reopen(self.grace_s):
                    raise self._gone(e) from None
                self._configure()
                at = self._move(goals, deadline)
            self._moving = False
            return at
        except DeviceFault:
            self._make_safe()
            raise

    def _move(self, goals: dict[int, int], deadline: float) -> Array:
        present = self._lately() or self.states()
        self._rest = None
        sent = self.clock.now()
        state = self._start(goals, present)
        begun = self.clock.now()
        way = np.array([goals[i] - s.position for i, s in zip(self.ids, present)]) * COUNT
        seconds = float(move_time(way, self.velocity, self.acceleration))
        ready = begun + seconds
        still, late = 0, False
        while not self._stopped.is_set():
            self._check(state, goals)
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

    def _start(self, goals: dict[int, int], present: list[State]) -> list[State]:
        """Give the servos their goals and see that they have them. Raises DeviceFault."""
        self._check(present, None)
        self._rearm([j for j, s in zip(self.joints, present) if s.watchdog == t.TRIPPED])
        data = self._profile(present, goals)
        for _ in range(ATTEMPTS):
            with self.bus.lock:  # a stop comes before or after, not in between
                if self._stopped.is_set():
                    return present
                self.bus.sync_write(t.MOVE, data)
            state = self.states()
            wrong = [j for j, s in zip(self.joints, state) if s.goal != goals[j.id]]
            if not wrong:
                return state
            self._check(state, None)
            self._rearm([j for j, s in zip(self.joints, state) if s.watchdog == t.TRIPPED])
        j = wrong[0]
        raise DeviceFault(j.name, f"does not take the goal {goals[j.id]}", "check its limits with `gonio doctor`")

    def _profile(self, present: Sequence[State], goals: dict[int, int]) -> dict[int, bytes]:
        """One ramp and one time for all axes: they start and stop together, so the way is a straight line."""
        way = np.array([abs(goals[i] - s.position) for i, s in zip(self.ids, present)]) * COUNT
        cruise, ramp = float((way / self.velocity).max()), float((way / self.acceleration).max())
        time_ms = max(int(np.ceil(1000 * float(move_time(way, self.velocity, self.acceleration)))), 2)
        ramp_ms = min(int(np.ceil(1000 * ramp / cruise)), time_ms // 2) if cruise > 0 else 1
        head = ramp_ms.to_bytes(4, "little") + time_ms.to_bytes(4, "little")
        return {i: head + goals[i].to_bytes(4, "little") for i in self.ids}

    def _rearm(self, tripped: list[Joint]) -> None:
        """Idle for longer than the watchdog waits: it tripped, as it should, and goals are read-only until told."""
        for joint in tripped:
            put(self.bus, joint, t.WATCHDOG, 0)
            put(self.bus, joint, t.WATCHDOG, watchdog_units(self.watchdog_s))

    def _check(self, state: Sequence[State], goals: dict[int, int] | None) -> None:
        """Raises DeviceFault for what any servo tells of itself."""
        for joint, s in zip(self.joints, state):
            if s.hardware:
                bits = s.hardware if s.hardware != 0x80 else self.bus.read(joint.id, t.HARDWARE_ERROR)
                if fault := hardware_fault(joint.name, bits):
                    raise fault
            if s.watchdog not in (t.TRIPPED, watchdog_units(self.watchdog_s)):
                raise DeviceFault(
                    joint.name,
                    "lost its settings: its supply dipped",
                    "check supply and cables, then `gonio resume`",
                )
            if goals is not None and s.watchdog == t.TRIPPED:
                raise DeviceFault(
                    joint.name, f"heard nothing for {self.watchdog_s:g} s and stopped", "is the host overloaded?"
                )
            if goals is not None and s.goal != goals[joint.id]:
                raise DeviceFault(joint.name, "somebody else gave it a goal", "let nobody else drive these servos")

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
        """Every goal becomes the present position. An axis on the move overshoots by what it needs to brake."""
        with self.bus.lock:
            self._rest = None
            for _ in range(ATTEMPTS):
                here = {j.id: min(max(s.position, j.lower), j.upper) for j, s in zip(self.joints, self.states())}
                self.bus.sync_write(t.MOVE, {i: BRAKE + n.to_bytes(4, "little") for i, n in here.items()})
                if all(s.goal == here[i] or s.watchdog == t.TRIPPED for i, s in zip(self.ids, self.states())):
                    return
        raise DeviceFault("stage", "does not take the order to stop", "cut the power of the servos")

    def _make_safe(self) -> None:
        """After a fault: torque held where the servos are, or released, as the rig's config says. Never raises."""
        self._moving = False
        try:
            if self.after_fault == "release":
                self.bus.sync_write(t.TORQUE, {i: b"\0" for i in self.ids})
                self.states()  # once this is answered, that has been obeyed
            else:
                self._halt()
        except (DeviceFault, Refused, NoAnswer, OSError):
            pass

    # ---- where it is -----------------------------------------------------------------------------------------------

    def states(self) -> list[State]:
        """One sync read of all servos. Raises DeviceFault, PortGone."""
        data, errors = self.bus.sync_read(t.POLL, self.ids)
        return [decode(data[i], errors[i]) for i in self.ids]

    def _lately(self) -> list[State] | None:
        """The servos as last seen, if they were at rest and that was so lately that no watchdog has tripped since."""
        rest = self._rest
        return rest[1] if rest and time.monotonic() - rest[0] < self.watchdog_s / 4 else None

    def pose(self) -> Array:
        try:
            return self._pose(self._lately() or self.states())
        except PortGone as e:
            if not self.bus.reopen(self.grace_s):
                raise self._gone(e) from None
            self._configure()
            return self._pose(self.states())

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
