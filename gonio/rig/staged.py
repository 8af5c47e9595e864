"""A rig made of devices: a stage, a detector, a light; simulated, on a wire, or real, all driven by this one class.

    for each pair, in the planned order:
        move (round the stay-out cone, from below against backlash) -> settle -> read -> reduce

Nothing moves before homing is confirmed, outside the limits, or into the cone. After a fault the light is off.
"""

import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import backlash_of, geometry_calibration, park_pose
from gonio.rig.clock import Clock, VirtualClock
from gonio.rig.dark_after import dark_after_errors
from gonio.rig.devices import Detector, Light, Stage, Visited
from gonio.rig.errors import SafetyStop
from gonio.rig.guarded import GuardedDetector, GuardedLight, GuardedStage
from gonio.rig.motion.approach import Approach
from gonio.rig.motion.driver import Driver
from gonio.rig.motion.envelope import Envelope
from gonio.rig.motion.pending import Pending
from gonio.rig.motion.plan import Planner
from gonio.rig.on_way import Way
from gonio.rig.signal.levels import Levels
from gonio.rig.signal.radiometry import Dark, Radiometry
from gonio.rig.signal.watch import Watch
from gonio.rig.uninterrupted import uninterrupted

LOOK_EVERY = 160  # measurements, where `plan.look_every` says nothing
LOOKS = -(1 << 42)  # ids of what a look reads, downwards from here
BRAKING_S = 0.05  # after which arms that were told to stop in full motion are at rest


class StagedRig:
    """Implements `gonio.rig.devices.Rig`.

    announce(id), if given, is called before each measurement: simulated devices draw its noise from it (dark readings
    have negative ids). release(), if given, lets the devices go at `close`. `surrogate` saves trials of ranges.
    """

    calibration_ids: Mapping[str, str] = MappingProxyType({})  # for the run's provenance
    surrogate: Callable[[Array, Array], Array | None] | None = None
    on_way: Callable[[Way], None] | None = None

    def __init__(
        self,
        config: RigConfig,
        envelope: Envelope,
        stage: Stage,
        detector: Detector,
        light: Light,
        radiometry: Radiometry,
        clock: Clock,
        plan: PlanConfig,
        isotropic: bool,
        *,
        simulated: bool,
        announce: Callable[[int], None] = lambda number: None,
        release: Callable[[], None] = lambda: None,
    ):
        self.config, self.envelope, self.plan = config, envelope, plan
        self.stage, self.detector, self.light = stage, detector, light
        own = simulated  # what a simulated device raises may come of the code of whoever made its sample
        blind, channels = simulated or config.detector == "camera", len(radiometry.gain)
        self._stage, self._light = stage, light = GuardedStage(stage, "stage", own), GuardedLight(light, "light", own)
        self._detector = detector = GuardedDetector(detector, "detector", own, channels, blind)
        self.radiometry, self.clock, self.simulated = radiometry, clock, simulated
        self.announce, self._release = announce, release
        self.planner = Planner(envelope, plan, isotropic)
        backlash = backlash_of(config, geometry_calibration(config))
        self.approach = Approach(envelope, backlash, plan.one_sided, self.planner.free)
        self.levels = Levels(detector, light, radiometry, config.exposure_s, plan, announce)
        every = plan.look_every if plan.look_every is not None else LOOK_EVERY * (config.depth in ("real", "wire"))
        self.watch = Watch(detector, light, radiometry, config.exposure_s, every, lambda k: announce(LOOKS - k))
        self._pending = Pending.none(len(envelope.axes))
        self._rest = envelope.snap(park_pose(config))
        self._measured_at: Array | None = None  # where the arms were at the last measurement, if that is known
        self._stop = threading.Event()
        self.driver = Driver(config.name, stage, envelope, self.approach, self.planner, self._stop)
        self._go, self._seconds = self.driver.go, self.driver.seconds
        # a virtual clock has one thread only, and nothing to gain from a second
        overlap = plan.overlap and not isinstance(clock, VirtualClock)
        self._ahead = ThreadPoolExecutor(1, "stage") if overlap else None

    @property
    def channels(self) -> int:
        return len(self.radiometry.gain)

    def reachable(self, wi: Array, wo: Array) -> NDArray[np.bool_]:
        return self.envelope.reachable(wi, wo)

    def visit(self, wi: Array, wo: Array, ids: NDArray[np.int64]) -> Iterator[Visited]:
        """One measurement at a time, in the planned order; pairs that cannot be reached come last, as NaN.

        Raises SafetyStop, DeviceFault; the light is off then, as after any other error, which halts the motors as well.
        """
        self._begin()
        wi, wo, ids = np.asarray(wi, float), np.asarray(wo, float), np.asarray(ids, np.int64)
        done = np.zeros(len(ids), bool)
        with self._dark_after_errors():
            self._light.on()
            self._light.level(1)
            for which, poses in self._tours(wi, wo, ids):
                done[which] = True
                yield from self._drive(wi[which], wo[which], ids[which], poses)
                if self._stop.is_set():
                    return
            if self.watch.due_at_the_end:
                self.look()
        rest = np.flatnonzero(~done)
        if len(rest):
            yield self._nothing(ids[rest], wi[rest], wo[rest])

    def _tours(self, wi: Array, wo: Array, ids: NDArray[np.int64]) -> Iterator[tuple[NDArray[np.int64], Array]]:
        """First what a run that was interrupted had planned, if that is what is asked for; then the rest."""
        numbers, poses = self._pending.left()
        place = {int(n): k for k, n in enumerate(ids)}
        # as if no look had led elsewhere: when looks are made must not decide how a pair is shown
        start = self._stage.pose() if self._measured_at is None else self._measured_at
        left = np.arange(len(ids))
        if numbers and all(n in place for n in numbers):
            which = np.array([place[n] for n in numbers])
            yield which, poses
            start, left = poses[-1], np.setdiff1d(left, which)
        for tour in self.planner.tours(wi[left], wo[left], start):
            which = left[tour.which]
            self._pending = Pending(ids[which].tolist(), tour.poses)
            yield which, tour.poses

    def _drive(self, wi: Array, wo: Array, ids: NDArray[np.int64], poses: Array) -> Iterator[Visited]:
        """Measure at each pose (M, A) of a tour."""
        begun = self.clock.now()
        predicted = self._predict(wi, wo)
        before = np.concatenate([self._stage.pose()[None], poses[:-1]])
        straight = self.envelope.path_clear(before, poses)  # of all at once: one by one it takes far longer
        moving: Future[Array | None] | None = None
        for k, number in enumerate(ids.tolist()):
            if self.levels.reference_is_due and self._go(self._rest) is not None:
                self.clock.sleep(self.config.settle_s)
                self.levels.look_at_reference(number)
            dark = self.levels.dark(number)
            self.announce(number)
            at = moving.result() if moving else self._go(poses[k], before[k] if straight[k] else None)
            if self._stop.is_set():
                return  # wherever it came to rest, that is no measurement
            moving = None
            if at is None:
                seen = self._nothing(ids[k : k + 1], wi[k : k + 1], wo[k : k + 1])
            else:
                self.clock.sleep(self.config.settle_s)
                if predicted is not None:
                    self._detector.expect(self.radiometry.expected(predicted[k], wi[k], wo[k], self.config.exposure_s))
                seen = self._measure(number, poses[k], at, dark, begun)
                self.levels.count()
            begun = self.clock.now()
            self._pending.done += 1
            elsewhere = self.levels.reference_is_due or self.watch.due  # before the next measurement
            if self._ahead and k + 1 < len(ids) and not elsewhere:
                moving = self._ahead.submit(self._go, poses[k + 1], poses[k] if straight[k + 1] else None)
            yield seen
            if self.watch.due:
                self.look()
                begun = self.clock.now()

    def look(self) -> None:
        """Whether the rig still sees what it should, by repeating a bright measurement. Raises LostSight.

        To be called at the end of a run as well: what was measured since the last look is not confirmed until then.
        """
        if not self.watch.every or not self.watch.since:
            return
        with self._dark_after_errors():
            self.watch.refuse_frozen()
            at = self._stage.pose()
            seen = self.watch.nearest(lambda poses: self._seconds(poses - at))
            if seen is None:
                self.watch.ask_only()
            elif not self._stop.is_set() and self._go(seen.pose) is not None:
                self.clock.sleep(self.config.settle_s)
                self.watch.look(seen, self.levels.dark(self.watch.since[-1]))

    def _predict(self, wi: Array, wo: Array) -> Array | None:
        """f (M, C) that the surrogate expects; None where it is not asked, or does not know."""
        return self.surrogate(wi, wo) if self.plan.predict_range and self.surrogate is not None else None

    def _measure(self, number: int, pose: Array, at: Array, dark: Dark, begun: float) -> Visited:
        reading = self._detector.read(self.config.exposure_s)
        wi, wo = self.envelope.kinematics.forward(at)
        f, sigma = self.radiometry.reduce(reading, dark, wi, wo, self.levels.drift, self.levels.drift_sigma)
        if not self.config.use_achieved and np.any(np.abs(at - pose) > 1.5 * self.envelope.resolution + 1e-9):
            f = np.full_like(f, np.nan)  # a servo stopped short; the counts stay in the record
        self.watch.note(number, at, reading, dark)
        self._measured_at = at
        raw = {**reading.raw, "dark": dark.value.tolist(), "drift": self.levels.drift, "pose_rad": at.tolist()}
        seconds = np.array([self.clock.now() - begun])
        saturated = np.array([reading.saturated])
        return Visited(np.array([number]), wi[None], wo[None], f[None], sigma[None], saturated, (raw,), seconds)

    def _nothing(self, ids: NDArray[np.int64], wi: Array, wo: Array) -> Visited:
        n = len(ids)
        nan = np.full((n, self.channels), np.nan)
        return Visited(ids, wi, wo, nan, nan, np.zeros(n, bool), ({},) * n, np.zeros(n))

    def _begin(self) -> None:
        """A new task: stops asked for before it are over, and so is a motion that the one before began ahead."""
        if self._ahead:
            self._ahead.submit(lambda: None).result()
        self._stop.clear()
        self._stage.allow()

    def _dark_after_errors(self) -> AbstractContextManager[None]:
        ahead = self._stage.stop if self._ahead else lambda: None
        return dark_after_errors(self._light.off, self.stop, ahead)

    def state(self) -> dict[str, Any]:
        """Levels, and the tour under way; of simulated devices, also where they are."""
        levels, pending = self.levels.state(), self._pending
        state: dict[str, Any] = {"levels": levels, "tour": pending.text, "done": pending.done}
        if isinstance(self.clock, VirtualClock):
            state["clock_s"] = self.clock.now()
            state["devices"] = {name: device.state() for name, device in self._resumable()}
        return state

    def restore(self, state: dict[str, Any]) -> None:
        self._measured_at = None
        self._pending = Pending.of_text(state["tour"], state["done"], len(self.envelope.axes))
        if isinstance(self.clock, VirtualClock):
            self.clock.sleep(state["clock_s"] - self.clock.now())
            for name, device in self._resumable():
                device.restore(state["devices"][name])
        if self.simulated:  # a real lamp and detector are not what they were: levels are taken anew
            self.levels.restore(state["levels"])

    def _resumable(self) -> tuple[tuple[str, Any], ...]:
        """Devices on a virtual clock know how to go on where they were."""
        return ("stage", self.stage), ("detector", self.detector)

    def drive(self, wi: Array, wo: Array) -> tuple[Array, Array]:
        """Go to where a pair (1, 3), (1, 3) is shown and stay there; the directions achieved, (3,) each.

        Raises SafetyStop where the rig cannot reach it.
        """
        self._begin()
        self._measured_at = None
        tour = next(self.planner.tours(wi, wo, self._stage.pose()), None)
        at = None if tour is None else self._go(tour.poses[0])
        if at is None:
            raise SafetyStop(f"rig {self.config.name}: that pair of directions is out of reach; not driven there")
        self.clock.sleep(self.config.settle_s)
        return self.envelope.kinematics.forward(at)

    def jog(self, axis: str, angle: float) -> Array:
        """Turn one axis by `angle` rad, by a clear way; the pose achieved (A,). Raises SafetyStop, KeyError."""
        self._begin()
        self._measured_at = None
        step = np.zeros(len(self.config.axis_names))
        step[dict(zip(self.config.axis_names, range(len(step))))[axis]] = angle
        goal = self.envelope.snap(self._stage.pose() + step)
        at = self._go(goal) if self.envelope.inside(goal) else None
        if at is None:
            way = f"{np.degrees(angle):+.2f} degrees"
            raise SafetyStop(f"{axis}: {way} leads out of its limits or into the stay-out cone")
        return at

    def home(self) -> None:
        """Confirm the zero of every axis. Raises DeviceFault."""
        self._stage.home()

    def park(self) -> None:
        """Light off, arms to the pose of rest by a clear way."""
        self._light.off()
        self._begin()
        self._measured_at = None
        self._go(self._rest)

    def stop(self) -> None:
        self._stop.set()
        self._stage.stop()

    def close(self) -> None:
        halted = self._stop.is_set()
        self._stop.set()
        with uninterrupted(), ExitStack() as last_first:  # each of them, whatever becomes of the others
            last_first.callback(self._release)
            if halted or self._ahead:
                last_first.callback(self.clock.sleep, BRAKING_S)
            last_first.callback(self._light.off)
            if self._ahead:  # a motion begun ahead of its turn has nobody who waits for its end
                last_first.callback(self._ahead.shutdown)
                last_first.callback(self._stage.stop)
