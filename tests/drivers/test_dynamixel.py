"""The stage of servos on an emulated bus: it configures, arrives, stops, refuses, and names what fails."""

import threading

import numpy as np
import pytest

from drivers.dynamixel import tables as t
from drivers.dynamixel.bus import Bus
from drivers.dynamixel.stage import COUNT, DynamixelStage
from gonio.rig.build import envelope_of
from gonio.rig.clock import VirtualClock
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.rig.motion.profile import move_time
from sim.wire.servo import Servo
from tests.drivers.bench import AXES, IDS, WIRE, Bench, pose


@pytest.fixture
def bench(tmp_path):
    bench = Bench(tmp_path)
    bench.stage.connect()
    yield bench
    bench.close()


def test_configured_and_read_back(bench):
    for joint in bench.stage.joints:
        s = bench.servos[joint.id]
        assert s.get(44) == joint.velocity == 48 and s.get(10) == t.TIME_BASED
        assert (s.get(9), s.get(11), s.get(52), s.get(48)) == (
            0,
            3,
            joint.lower,
            joint.upper,
        )
        assert s.get(64) == 1 and s.get(98) == 25 and s.get(82) == t.I_GAIN and s.get(112) == t.GENTLE_MS[1]
    bench.stage.home()
    assert bench.stage.homed


def test_arrives_on_the_count(bench):
    rng = np.random.default_rng(1)
    for _ in range(30):
        goal = pose(*rng.integers(-900, 900, 4))
        np.testing.assert_array_equal(bench.stage.move(goal, 20.0), goal)
        np.testing.assert_allclose(np.radians([s.true_angle_deg() for s in bench.servos.values()]), goal, atol=1e-9)


def test_the_way_is_a_straight_line_and_stays_out_of_the_cone():
    """Moves that the planner calls clear are: as the emulated servos drive them, all in step to half a count each."""
    envelope, clock, rng = envelope_of(WIRE), VirtualClock(), np.random.default_rng(0)
    stage = DynamixelStage(Bus("-", 1_000_000, {}), AXES, IDS, "XM430-W350", np.zeros(4), clock)
    deepest, bent, slower, moves = np.inf, 0.0, 0.0, 0
    while moves < 400:
        a, b = (envelope.snap(rng.uniform(envelope.lower, envelope.upper)) for _ in range(2))
        apart = envelope.separation(np.stack([a, b])) > envelope.stay_out + envelope.margin
        if not apart.all() or not envelope.path_clear(a[None], b[None])[0]:
            continue
        moves += 1
        at, goals = stage._counts(a), stage._counts(b)
        servos = [Servo(k, clock, at[k]) for k in stage.ids]
        profile = stage._profile((np.array(list(goals.values())) - np.array(list(at.values()))) * COUNT)
        for s, goal in zip(servos, goals.values()):
            data = profile + goal.to_bytes(4, "little")
            assert s.write(10, b"\4") == s.write(64, b"\1") == s.write(108, data) == 0
        seconds = max(s._seconds() for s in servos)
        when = np.linspace(0, seconds, 50)
        way = (np.array([[s.position(s._begun + x) for s in servos] for x in when]) - t.ZERO) * COUNT
        deepest = min(deepest, np.degrees(envelope.separation(way).min() - envelope.stay_out))
        off, d = way - a, b - a
        bent = max(bent, np.degrees(np.abs(off - (off @ d / (d @ d))[:, None] * d).max()))
        slower = max(slower, seconds - float(move_time(d, stage.velocity, stage.acceleration)))
    assert deepest > -0.01 and bent < 0.05 and slower < 0.003


@pytest.mark.parametrize("bad", [pose(1200, 0, 0, 0), pose(0, 2048, 0, 0), np.array([0, np.nan, 0, 0])])
def test_never_beyond_limits(bench, bad):
    with pytest.raises(SafetyStop, match="outside its limits"):
        bench.stage.move(bad, 10.0)
    assert all(s.position(bench.clock.now()) == 2048 for s in bench.servos.values())


def test_wrong_model_says_expected_and_found(tmp_path):
    bench = Bench(tmp_path)
    bench.servos[3].put(0, 1060)
    with pytest.raises(DeviceFault, match=r"detector: servo 3 should be XM430-W350 \(model 1020\) and is XL430-W250"):
        bench.stage.connect()
    bench.close()


def test_absent_servo_is_named(tmp_path):
    bench = Bench(tmp_path)
    bench.bus.deaf.add(2)
    with pytest.raises(DeviceFault, match=r"turntable \(id 2\): no answer on the bus; check its cable"):
        bench.stage.connect()
    bench.close()


@pytest.mark.parametrize(("bit", "cause"), [(5, "overload"), (2, "overheated"), (0, "supply voltage")])
def test_hardware_faults_are_named(bench, bit, cause):
    bench.servos[3].fail(bit)
    with pytest.raises(DeviceFault, match=rf"detector: {cause}.*then reboot it"):
        bench.stage.move(pose(50, 50, 50, 50), 10.0)


@pytest.mark.parametrize(("after", "torque"), [("hold", 1), ("release", 0)])
def test_torque_after_a_fault_is_as_the_config_says(tmp_path, after, torque):
    bench = Bench(tmp_path, after_fault=after)
    bench.stage.connect()
    bench.servos[3].fail(5)
    with pytest.raises(DeviceFault):
        bench.stage.move(pose(50, 50, 50, 50), 10.0)
    assert [bench.servos[k].get(64) for k in (1, 2, 4)] == [torque] * 3
    bench.close()


def test_reboot_writes_everything_again(bench):
    bench.servos[3].fail(5)
    with pytest.raises(DeviceFault):
        bench.stage.home()
    bench.stage.reboot("detector")
    s = bench.servos[3]
    assert s.get(64) == 1 and s.get(98) == 25 and s.get(82) == t.I_GAIN and s.get(112) == t.GENTLE_MS[1]
    np.testing.assert_array_equal(bench.stage.move(pose(5, 5, 5, 5), 10.0), pose(5, 5, 5, 5))


def test_a_dip_of_the_supply_is_noticed(bench):
    bench.servos[1].power_on()
    with pytest.raises(DeviceFault, match="light: lost its settings: its supply dipped"):
        bench.stage.move(pose(50, 50, 50, 50), 10.0)


def test_stuck_and_short(bench):
    bench.servos[4].troubles.stuck = True
    with pytest.raises(DeviceFault, match=r"azimuth: stopped 17\.6 degrees short"):
        bench.stage.move(pose(0, 0, 0, 200), 20.0)
    bench.servos[4].troubles.stuck = False
    bench.servos[4].troubles.droop = 10
    np.testing.assert_array_equal(bench.stage.move(pose(0, 0, 0, 200), 20.0), pose(0, 0, 0, 190))


def test_a_blocked_joint_runs_out_of_time(bench):
    bench.servos[1].put(44, 1)  # creeps
    with pytest.raises(DeviceFault, match=r"light: not there after 3\.0 s"):
        bench.stage.move(pose(900, 0, 0, 0), 3.0)


def test_a_servo_that_lies_about_its_position(tmp_path):
    bench = Bench(tmp_path, scale=1.0)
    bench.stage.poll_s = 0.02
    bench.stage.connect()
    bench.servos[2].troubles.lies = bench.servos[2].troubles.stuck = True
    with pytest.raises(DeviceFault, match="turntable: shows a position that it cannot have reached"):
        bench.stage.move(pose(0, 300, 0, 0), 20.0)
    bench.close()


def test_a_tripped_watchdog_is_armed_again(bench):
    for s in bench.servos.values():
        s._fed -= 10
    np.testing.assert_array_equal(bench.stage.move(pose(9, 9, 9, 9), 10.0), pose(9, 9, 9, 9))
    assert bench.servos[1].get(98) == 25


def test_a_host_that_dies_stops_the_servos(tmp_path):
    bench = Bench(tmp_path, scale=1.0, watchdog_s=0.04)
    bench.stage.connect()
    goals = {1: 3000, 2: 2048, 3: 2048, 4: 2048}
    profile = bench.stage._profile(pose(952, 0, 0, 0))
    bench.stage.servos.start(goals, profile, bench.stage.states(), threading.Event())
    with bench.server.lock:  # nothing has come from the host for longer than the watchdogs wait
        for servo in bench.servos.values():
            servo._fed -= 0.3
            servo.refresh()
        begun = bench.servos[1].position(bench.clock.now())
    bench.servos[1].feed()
    assert bench.servos[1].get(98) == 255
    at = bench.servos[1].position(bench.clock.now())
    assert at < begun + 100 and bench.servos[1].position(bench.clock.now() + 100) == at
    bench.close()


def test_a_stop_is_obeyed_within_a_few_packets(tmp_path):
    bench = Bench(tmp_path, scale=1.0)
    bench.stage.poll_s = 0.02
    bench.stage.connect()
    on_the_way, packets = threading.Event(), []
    bench.line.plans[bench.line.packets + 10] = on_the_way.set

    def stop():
        assert on_the_way.wait(60)
        before = bench.line.packets
        bench.stage.stop()
        packets.append(bench.line.packets - before)

    thread = threading.Thread(target=stop)
    thread.start()
    at = bench.stage.move(pose(900, 0, 0, 0), 20.0)
    thread.join()
    assert 0 < at[0] < 900 * COUNT
    # a poll under way, where they are, the order, whether it was taken; the mover says the same once more
    assert packets[0] <= 8 + 3 * bench.stage.bus.failures
    here = [s.position(bench.clock.now() + 1) for s in bench.servos.values()]
    assert here == [s.position(bench.clock.now() + 100) for s in bench.servos.values()]
    np.testing.assert_array_equal(bench.stage.move(pose(0, 0, 0, 0), 20.0), bench.stage.pose())  # not until allowed
    bench.stage.allow()
    bench.close()


def test_two_programs_cannot_have_one_port(bench):
    other = Bus(str(bench.line.path), 1_000_000, {})
    stage = DynamixelStage(other, AXES, IDS, "XM430-W350", np.zeros(4), bench.clock)
    with pytest.raises(DeviceFault, match="in use by another program"):
        stage.connect()


def test_port_gone_and_back_in_a_move(tmp_path):
    bench = Bench(tmp_path, scale=1.0)
    bench.stage.connect()
    bench.stage.poll_s = 0.02
    bench.line.plans[bench.line.packets + 8] = lambda: bench.server.flap(bench.line)
    np.testing.assert_array_equal(bench.stage.move(pose(200, 0, 0, 0), 20.0), pose(200, 0, 0, 0))
    bench.close()


@pytest.mark.parametrize("moments", [(2, 5), (2, 20, 30), (3, 4, 6, 9, 15, 40)])
@pytest.mark.parametrize("act", ["move", "pose", "home", "connect"])
def test_absences_one_after_another_are_one_longer_absence(tmp_path, act, moments):
    """Also while it is being opened and configured anew. Each flap comes at a packet's number."""
    bench = Bench(tmp_path, scale=1.0)
    if act != "connect":
        bench.stage.connect()
    first = bench.line.packets
    for k in moments:
        bench.line.plans[first + k] = lambda: bench.server.flap(bench.line)
    goal = pose(60, 0, 0, 0)
    for _ in range(60):
        if not bench.line.plans:
            break
        bench.stage._rest = None
        if act == "move":
            np.testing.assert_array_equal(bench.stage.move(goal, 20.0), goal)
            goal = pose(60, 0, 0, 0) - goal
        elif act == "connect":
            bench.stage.connect()
            bench.stage.bus.close()
        else:
            getattr(bench.stage, act)()
    assert not bench.line.plans, "not every flap came"
    assert bench.servos[1].get(98) == 25
    bench.close()


def test_port_gone_for_good(bench):
    bench.stage.grace_s = 0.05
    bench.server.unplug(bench.line)
    with pytest.raises(DeviceFault, match="gone; plug in its USB cable"):
        bench.stage.move(pose(1, 0, 0, 0), 10.0)
