"""The class that drives devices, with devices of its own: order of events, overlap, faults."""

import threading

import numpy as np
import pytest

from gonio.config import load_config
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.geometry import from_angles
from gonio.rig.build import envelope_of, park_pose, radiometry_of
from gonio.rig.clock import RealClock
from gonio.rig.devices import Reading
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.rig.signal.levels import READINGS as DARKS
from gonio.rig.staged import StagedRig
from tests.conftest import ROOT

SIM = load_config(ROOT / "configs/rigs/sim.yaml", RigConfig).model_copy(update={"settle_s": 0.0})


class Log(list):
    """What happened, in order."""


class Stage:
    def __init__(self, log, envelope):
        self.log, self.axes, self.homed = log, envelope.axes, True
        self.at = envelope.snap(park_pose(SIM))
        self.fail_at = None
        self.halted = threading.Event()

    def move(self, pose, deadline):
        self.log.append("move")
        if self.fail_at == self.log.count("move"):
            raise DeviceFault("turntable", "overload", "let it cool, then home")
        self.at = np.array(pose)
        return self.at

    def pose(self):
        return self.at

    def home(self):
        self.homed = True

    def stop(self):
        self.halted.set()

    def allow(self):
        self.halted.clear()

    def park(self): ...


class Detector:
    def __init__(self, log):
        self.log, self.expected = log, []

    def expect(self, signal):
        self.expected.append(signal)

    def read(self, exposure=None):
        self.log.append("read")
        return Reading(np.full(3, 0.5), np.full(3, 0.01), False, {"exposure_s": exposure})


class Light:
    def __init__(self, log):
        self.log, self.lit = log, False

    def on(self):
        self.lit = True

    def off(self):
        self.log.append("off")
        self.lit = False

    def level(self, fraction):
        self.log.append(f"level {fraction}")


def make(plan=None):
    log, envelope = Log(), envelope_of(SIM)
    devices = Stage(log, envelope), Detector(log), Light(log)
    radiometry, plan = radiometry_of(SIM, 3), plan or PlanConfig(tour=False)
    rig = StagedRig(SIM, envelope, *devices, radiometry, RealClock(), plan, False, simulated=False)
    return rig, log


WI, WO = from_angles(np.full(5, 0.5), 0.0), from_angles(np.full(5, 0.9), np.linspace(1, 3, 5))
IDS = np.arange(5)


def test_nothing_moves_before_what_was_read_is_stored():
    rig, log = make()
    for _ in rig.visit(WI, WO, IDS):
        log.append("stored")
    assert log == ["level 1", "level 0", *["read"] * DARKS, "level 1", *["move", "read", "stored"] * 5]
    rig.close()
    assert not rig.light.lit


def test_overlap_moves_while_storing():
    rig, log = make(PlanConfig(tour=False, overlap=True))
    count = 0
    for k, _ in enumerate(rig.visit(WI, WO, IDS)):
        if k < 4:
            rig._ahead.submit(lambda: None).result()  # the one thread of the stage has the next move behind it
        assert log.count("move") == min(k + 2, 5)
        count += 1
    assert count == 5
    rig.close()


def test_dark_is_shared_and_renewed():
    rig, log = make(PlanConfig(tour=False, dark_every=2))
    list(rig.visit(WI, WO, IDS))
    assert log.count("read") == 5 + 3 * DARKS


def test_a_fault_puts_the_light_out_and_keeps_what_was_read():
    rig, log = make()
    rig.stage.fail_at = 3
    seen = []
    with pytest.raises(DeviceFault, match="turntable: overload; let it cool"):
        for v in rig.visit(WI, WO, IDS):
            seen.append(v)
    assert len(seen) == 2 and not rig.light.lit and log[-1] == "off"


def test_a_stop_from_another_thread_ends_the_visit_without_another_move():
    rig, log = make()
    visit = rig.visit(WI, WO, IDS)
    next(visit)
    thread = threading.Thread(target=rig.stop)
    thread.start()
    thread.join()
    assert list(visit) == [] and log.count("move") == 1 and rig.stage.halted.is_set()


def test_a_move_cut_short_by_a_stop_is_no_measurement():
    rig, log = make()
    move = rig.stage.move

    def interrupted(pose, deadline):
        rig.stop()
        return move(0.5 * (rig.stage.pose() + pose), deadline)

    rig.stage.move = interrupted
    assert list(rig.visit(WI, WO, IDS)) == [] and log.count("move") == 1


def test_devices_are_let_go():
    log, envelope = Log(), envelope_of(SIM)
    gone = []
    devices = Stage(log, envelope), Detector(log), Light(log)
    plan, release = PlanConfig(), lambda: gone.append(True)
    rig = StagedRig(
        SIM, envelope, *devices, radiometry_of(SIM, 3), RealClock(), plan, False, simulated=False, release=release
    )
    rig.close()
    assert gone == [True] and log == ["off"]


def test_not_homed():
    rig, log = make()
    rig.stage.homed = False
    with pytest.raises(SafetyStop, match="gonio home"):
        list(rig.visit(WI, WO, IDS))
    assert "move" not in log


def test_the_surrogate_tells_the_detector_what_to_expect():
    rig, _ = make()
    rig.surrogate = lambda wi, wo: np.full((len(wi), 3), 0.25)
    list(rig.visit(WI, WO, IDS))
    np.testing.assert_allclose(rig.detector.expected[0], np.pi * 0.25 * np.cos(0.5), rtol=1e-12)


def test_negative_f_is_kept():
    rig, _ = make()
    dark_then_less = iter([0.5] * DARKS + [0.4] * 5)
    rig.detector.read = lambda exposure: Reading(
        np.full(3, next(dark_then_less)), np.full(3, 0.01), False, {"exposure_s": exposure}
    )
    f = np.concatenate([v.f for v in rig.visit(WI, WO, IDS)])
    assert np.all(f < 0)


def test_closed_while_the_next_motion_is_under_way_it_is_stopped():
    """With overlap the stage is ahead of the loop: whoever closes the rig must not wait for the arms to arrive."""
    rig, log = make(PlanConfig(overlap=True))
    under_way, move = threading.Event(), rig.stage.move

    def slow(pose, deadline):
        if log.count("move") >= 1:
            under_way.set()
            assert rig.stage.halted.wait(30)
        return move(pose, deadline)

    rig.stage.move = slow
    visit = rig.visit(WI, WO, IDS)
    next(visit)
    assert under_way.wait(30)
    rig.close()
    assert rig.stage.halted.is_set() and log[-1] == "off" and list(visit) == []


def test_a_fault_stops_the_motion_that_was_ahead_of_it():
    rig, log = make(PlanConfig(overlap=True, reference_every=2))
    looks = []

    def look(number):
        looks.append(number)
        if len(looks) == 2:
            raise DeviceFault("detector", "no reply", "check its cable")

    rig.levels.look_at_reference = look
    with pytest.raises(DeviceFault):
        for _ in rig.visit(WI, WO, IDS):
            if rig.levels._since == 1:
                rig.levels._since = 2
    assert rig.stage.halted.is_set() and log[-1] == "off"


def test_stopped_short_of_a_waypoint_the_rest_of_the_way_is_planned_anew():
    """A leg that is clear from the waypoint need not be from 0.9 degrees beside it."""
    rig, _ = make()
    envelope, rng, tried = rig.envelope, np.random.default_rng(3), 0
    while tried < 5:
        a, b = (envelope.snap(rng.uniform(envelope.lower, envelope.upper)) for _ in range(2))
        if not (envelope.separation(np.stack([a, b])) > envelope.stay_out + 0.01).all():
            continue
        legs = rig.approach.legs(a, b, rig._seconds)
        if legs is None or len(legs) == 1:
            continue
        beside = envelope.snap(legs[0] + np.radians(rng.uniform(-0.9, 0.9, (50, 4))))
        outside = envelope.inside(beside) & (envelope.separation(beside) > envelope.stay_out + 0.001)
        bad = outside & ~envelope.path_clear(beside, np.broadcast_to(legs[1], beside.shape))
        if not bad.any():
            continue
        tried += 1
        rig.stage.at, ends = a, iter([beside[bad.argmax()]])
        driven = []

        def move(pose, deadline, rig=rig, ends=ends, driven=driven):
            driven.append((rig.stage.at, pose))
            rig.stage.at = next(ends, pose)
            return rig.stage.at

        rig.stage.move = move
        assert np.array_equal(rig._go(b), b)
        starts, goals = (np.array(x) for x in zip(*driven))
        assert envelope.path_clear(starts, goals).all() and len(driven) >= 3
