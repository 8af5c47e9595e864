"""A stage of stepper motors behind a Grbl controller; its units are degrees.

    G90 G53 G1 X.. Y.. F..  -> ok -> ? every poll until it is Idle at the goal

Grbl moves all axes of a line together, along a straight line. Steppers have no encoders: where the controller says it
is, it is as long as no step was lost. It forgets that when its port is opened (an Arduino restarts), so every opening
needs homing, which drives each axis to its switch.
"""

import math
import threading
from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np

from drivers.gone import PortGone
from drivers.grbl import codes
from drivers.grbl.controller import HOLD, RESET, Alarm, Controller, Report
from gonio.config.devices import GrblAxis
from gonio.geometry import Array
from gonio.rig.clock import Clock
from gonio.rig.devices import Axis
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.rig.motion.profile import move_time

T = TypeVar("T")

LETTERS = "XYZABC"
ARRIVED_DEG = 0.05  # off the goal that still is the goal: a step or two
STANDS = 5  # polls in a row that show it at rest, and not at the goal
HOLDS = 400  # polls within which a feed hold has come to rest
SLOWER = 0.99  # of what the rig's YAML says: rounding of settings


class GrblStage:
    """Implements `gonio.rig.devices.Stage`. Call `connect` first. poll_s: seconds of the clock between two polls."""

    def __init__(
        self,
        controller: Controller,
        axes: tuple[Axis, ...],
        wiring: Mapping[str, GrblAxis],
        park: Array,
        clock: Clock,
        *,
        homing: bool = True,
        home_s: float = 120.0,
        poll_s: float = 0.05,
    ):
        self.controller, self._axes, self._park, self.clock = controller, axes, park, clock
        self.homing, self.home_s, self.poll_s = homing, home_s, poll_s
        self.wiring = [wiring[a.name] for a in axes]
        self.index = [LETTERS.index(w.letter) for w in self.wiring]
        self.sign = np.array([-1.0 if w.reversed else 1.0 for w in self.wiring])
        self.zero = np.array([w.zero_deg for w in self.wiring])
        self.lower, self.upper = (np.array([getattr(a, k) for a in axes]) for k in ("lower", "upper"))
        self.velocity = np.array([a.velocity for a in axes])
        self.acceleration = np.array([a.acceleration for a in axes])
        self.homed = False
        self._stopped = threading.Event()
        self._halting = threading.Lock()
        self._moving = self._homing = False

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self._axes

    # ---- coming up and going down ----------------------------------------------------------------------------------

    def connect(self) -> None:
        """Open the port, read back limits and speeds. Raises DeviceFault. Moves nothing."""
        self.homed = False
        try:
            self._there(self.controller.open)
            for fault in self.differences(self._there(self.controller.settings)):
                raise fault
        except BaseException:
            self.controller.close()
            raise

    def differences(self, settings: Mapping[int, float]) -> list[DeviceFault]:
        """What of its settings does not do for this rig: travel $130.., rate $110.., acceleration $120..."""
        wrong = []
        for axis, i in zip(self._axes, self.index):
            span = math.degrees(axis.upper - axis.lower)
            for number, what, need, unit in (
                (130 + i, "travel", span, "degrees"),
                (110 + i, "rate", SLOWER * 60 * math.degrees(axis.velocity), "degrees/min"),
                (120 + i, "acceleration", SLOWER * math.degrees(axis.acceleration), "degrees/s2"),
            ):
                if number not in settings:
                    remedy = "check devices.stage.axes and its firmware"
                    wrong.append(
                        DeviceFault(axis.name, f"the controller has no ${number} ({what} of {LETTERS[i]})", remedy)
                    )
                elif settings[number] < need - 0.01:
                    has = f"${number} allows a {what} of {settings[number]:g} {unit}, the rig's YAML needs {need:.4g}"
                    wrong.append(DeviceFault(axis.name, has, f"set ${number}, or the axis in the YAML"))
        return wrong

    def home(self) -> None:
        """Drives every axis to its switch, unless it was home already since its port was opened; without switches
        (`homing: false`), where it stands is what it says. Raises DeviceFault."""
        if self.homed and self._report().state == "Idle":
            return
        self.homed = False
        if self.homing and not self._stopped.is_set():
            self._drive_home()
        self._inside(self._angles(self._known(self._report())))
        self.homed = True

    def _drive_home(self) -> None:
        """A reset is all that ends homing before its time: by `stop`, or by whatever interrupts the wait."""
        self._homing = True
        try:
            self._there(lambda: self.controller.order("$H", self.home_s))
        except Alarm as e:
            raise DeviceFault(e.axis, e.cause, e.remedy) from None
        except DeviceFault:
            raise
        except BaseException:
            self._there(lambda: self.controller.send(RESET))
            raise
        finally:
            self._homing = False

    def _inside(self, pose: Array) -> None:
        out = (pose < self.lower - np.radians(ARRIVED_DEG)) | (pose > self.upper + np.radians(ARRIVED_DEG))
        if out.any():
            k = int(out.argmax())
            at = f"stands at {np.degrees(pose[k]):.1f} degrees, outside its limits"
            remedy = "check zero_deg and reversed in devices.stage.axes, and $27, the way back from its switch"
            raise DeviceFault(self._axes[k].name, at, remedy)

    def close(self) -> None:
        """At rest, then the port let go. Never raises."""
        try:
            if self.controller.is_open and self._moving:
                self.stop()
        except (DeviceFault, OSError):
            pass
        finally:
            self.controller.close()

    # ---- moving ----------------------------------------------------------------------------------------------------

    def move(self, pose: Array, deadline: float) -> Array:
        """Raises DeviceFault, naming cause and remedy; SafetyStop for a pose outside the limits."""
        goal = np.asarray(pose, float)
        line = self._line(goal)
        if self._stopped.is_set():
            return self.pose()
        if not self.homed:
            raise DeviceFault("stage", "does not know where it is", "`gonio home`")
        self._moving = True
        try:
            at = self._there(lambda: self._go(goal, line, deadline))
        except DeviceFault as e:
            self._make_safe(e)
            raise
        self._moving = False
        return at

    def _line(self, goal: Array) -> str:
        """Raises SafetyStop."""
        for axis, a in zip(self._axes, goal.tolist()):
            if not (math.isfinite(a) and axis.lower - 1e-9 <= a <= axis.upper + 1e-9):
                raise SafetyStop(
                    f"{axis.name}: {math.degrees(a):.3f} degrees lies outside its limits; not driven there"
                )
        machine = self.sign * np.degrees(goal) + self.zero
        return "G90 G53 G1 " + " ".join(f"{w.letter}{m:.3f}" for w, m in zip(self.wiring, machine))

    def _go(self, goal: Array, line: str, deadline: float) -> Array:
        here = self._angles(self._known(self.controller.report()))
        way = np.abs(goal - here)
        slowest = float((way / self.velocity).max())
        if slowest * np.degrees(self.velocity.max()) < 0.5e-3:  # less than is sent
            return here
        feed = 60 * float(np.linalg.norm(np.degrees(way))) / slowest  # degrees a minute along the line
        with self._halting:  # a stop comes before or after
            if self._stopped.is_set():
                return here
            self.controller.order(f"{line} F{feed:.1f}")
        begun = self.clock.now()
        ready = begun + float(move_time(way, self.velocity, self.acceleration))
        still, late = 0, False
        while not self._stopped.is_set():
            report = self._known(self.controller.report())
            at = self._angles(report)
            off = np.abs(at - goal)
            if report.state == "Idle":
                if np.degrees(off.max()) <= ARRIVED_DEG:
                    return at
                still += 1
            else:
                still = 0
            if still >= STANDS:
                raise DeviceFault(
                    self._axes[int(off.argmax())].name,
                    f"stopped {np.degrees(off.max()):.1f} degrees short",
                    "free it, then `gonio home`",
                )
            if late:
                name = self._axes[int(off.argmax())].name
                raise DeviceFault(
                    name, f"not there after {deadline:.1f} s", "is it blocked? free it, then `gonio home`"
                )
            self.clock.sleep(min(max(ready - self.clock.now(), 0.2 * self.poll_s), self.poll_s))
            late = self.clock.now() > begun + deadline
        with self._halting:  # whoever stops it has it stand by then
            pass
        return self._angles(self.controller.report())

    def _known(self, report: Report) -> Report:
        """Raises DeviceFault for a state in which it obeys no move."""
        match report.state:
            case "Alarm":
                self.homed = False
                raise DeviceFault("stage", *codes.error(9))
            case "Door":
                raise DeviceFault("stage", *codes.error(13))
            case "Hold" if not self._stopped.is_set():
                raise DeviceFault("stage", "somebody else holds it", "let nobody else drive it, then `gonio resume`")
            case "Check" | "Sleep":
                raise DeviceFault("stage", f"is in its state {report.state}", "switch it off and on, then `gonio home`")
        return report

    # ---- stopping --------------------------------------------------------------------------------------------------

    def stop(self) -> None:
        """It stands when this returns, and knows where. Raises DeviceFault where it cannot be reached."""
        self._stopped.set()
        # before any lock: it brakes now; homing does not listen to a hold
        self._there(lambda: self.controller.send(RESET if self._homing else HOLD))
        with self._halting:
            self._there(self._halt)
        self._moving = False

    def allow(self) -> None:
        self._stopped.clear()

    def _halt(self) -> None:
        """Feed hold until it stands; then the rest of the line is forgotten. A reset in a move would lose steps."""
        self.controller.send(HOLD)  # again: a line may have come behind the first
        for _ in range(HOLDS):
            report = self.controller.report()
            if report.state == "Idle" or (report.state == "Hold" and report.code in (0, None)):
                break  # and reset: one that stood already may be held all the same
            if report.state not in ("Run", "Hold", "Jog", "Home"):
                return
            self.clock.sleep(0.2 * self.poll_s)
        try:
            self.controller.reset()
        except Alarm as e:
            self.homed = self.homed and not e.lost
            raise DeviceFault(e.axis, e.cause, e.remedy) from None

    def _make_safe(self, e: DeviceFault) -> None:
        """After a fault: at rest. Never raises."""
        self._moving = False
        if isinstance(e, Alarm) and e.lost:
            self.homed = False
        try:
            self.controller.send(HOLD)
            with self._halting:
                self._halt()
        except (DeviceFault, OSError):
            pass

    # ---- where it is -----------------------------------------------------------------------------------------------

    def pose(self) -> Array:
        return self._angles(self._report())

    def park(self) -> None:
        way = self._park - self.pose()
        self.move(self._park, 5 + 2 * float(move_time(way, self.velocity, self.acceleration)))

    def _report(self) -> Report:
        return self._there(self.controller.report)

    def _angles(self, report: Report) -> Array:
        """rad, in the order of a pose."""
        if max(self.index) >= len(report.machine):
            missing = LETTERS[max(self.index)]
            raise DeviceFault("stage", f"has {len(report.machine)} axes, no {missing}", "check devices.stage.axes")
        machine = np.array([report.machine[i] for i in self.index])
        return np.radians(self.sign * (machine - self.zero))

    def _there(self, act: Callable[[], T]) -> T:
        """Raises DeviceFault where the port is gone: it has forgotten where it is."""
        try:
            return act()
        except PortGone as e:
            self.homed = False
            raise self.controller.gone(e) from None
