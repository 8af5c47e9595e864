"""The servos of a stage as one: made ready, given goals that they are seen to have, judged by what they say, halted.

Nothing is believed that was not read back. A host that dies is noticed by the servos' own watchdogs.
"""

import threading
from collections.abc import Sequence

from drivers.dynamixel import tables as t
from drivers.dynamixel.bus import Bus
from drivers.dynamixel.configure import Joint, configure, hardware_fault, healthy, put, recognise, watchdog_units
from drivers.dynamixel.poll import State, decode
from gonio.rig.errors import DeviceFault

BRAKE = (20).to_bytes(4, "little") + (40).to_bytes(4, "little")  # ramp and time of a stop, ms
ATTEMPTS = 3  # at giving the servos their goals
DEAF_S = 0.3  # after a reboot


class Servos:
    """`joints` on one bus, all of one model."""

    def __init__(self, bus: Bus, joints: Sequence[Joint], model: str, watchdog_s: float):
        self.bus, self.joints, self.model, self.watchdog_s = bus, tuple(joints), model, watchdog_s
        self.ids = [j.id for j in self.joints]

    def configure(self) -> None:
        """Recognise every servo and write what it has to know. Raises DeviceFault, PortGone. Moves nothing."""
        for joint in self.joints:
            self._make_ready(joint)

    def reboot(self, name: str) -> None:
        """At the operator's command only: all that the servo forgets is written again. The arm may sag meanwhile."""
        joint = next(j for j in self.joints if j.name == name)
        self.bus.reboot(joint.id)
        threading.Event().wait(DEAF_S)
        self._make_ready(joint)

    def _make_ready(self, joint: Joint) -> None:
        recognise(self.bus, joint, self.model)
        healthy(self.bus, joint)
        configure(self.bus, joint, self.watchdog_s)

    def states(self) -> list[State]:
        """One sync read of all servos. Raises DeviceFault, PortGone."""
        data, errors = self.bus.sync_read(t.POLL, self.ids)
        return [decode(data[i], errors[i]) for i in self.ids]

    def start(
        self, goals: dict[int, int], profile: bytes, present: list[State], stopped: threading.Event
    ) -> list[State]:
        """Give the servos their goals, id -> counts, by one profile, and see that they have them; unless `stopped`.

        Raises DeviceFault, PortGone.
        """
        self.check(present, None)
        self.rearm(present)
        data = {i: profile + goals[i].to_bytes(4, "little") for i in self.ids}
        for _ in range(ATTEMPTS):
            with self.bus.lock:  # a stop comes before or after, not in between
                if stopped.is_set():
                    return present
                self.bus.sync_write(t.MOVE, data)
            state = self.states()
            wrong = [j for j, s in zip(self.joints, state) if s.goal != goals[j.id]]
            if not wrong:
                return state
            self.check(state, None)
            self.rearm(state)
        j = wrong[0]
        raise DeviceFault(j.name, f"does not take the goal {goals[j.id]}", "check its limits with `gonio doctor`")

    def rearm(self, state: Sequence[State]) -> None:
        """Idle for longer than the watchdog waits: it tripped, as it should, and goals are read-only until told."""
        for joint, s in zip(self.joints, state):
            if s.watchdog == t.TRIPPED:
                put(self.bus, joint, t.WATCHDOG, 0)
                put(self.bus, joint, t.WATCHDOG, watchdog_units(self.watchdog_s))

    def check(self, state: Sequence[State], goals: dict[int, int] | None) -> None:
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

    def halt(self) -> None:
        """Every goal becomes the present position. An axis on the move overshoots by what it needs to brake."""
        with self.bus.lock:
            for _ in range(ATTEMPTS):
                here = {j.id: min(max(s.position, j.lower), j.upper) for j, s in zip(self.joints, self.states())}
                self.bus.sync_write(t.MOVE, {i: BRAKE + n.to_bytes(4, "little") for i, n in here.items()})
                if all(s.goal == here[i] or s.watchdog == t.TRIPPED for i, s in zip(self.ids, self.states())):
                    return
        raise DeviceFault("stage", "does not take the order to stop", "cut the power of the servos")

    def release(self) -> None:
        """Torque off: the arms sag."""
        self.bus.sync_write(t.TORQUE, {i: b"\0" for i in self.ids})
        self.states()  # once this is answered, that has been obeyed
