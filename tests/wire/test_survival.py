"""What a run survives while its devices live on: its host killed, its disk full, its clock set, its wire late."""

import signal
import threading
import time

import numpy as np
import pytest

from drivers.dynamixel import tables as t
from gonio.brdf.models.lambert import Lambert
from gonio.config import Material
from gonio.geometry import from_angles
from gonio.rig.errors import DeviceFault
from gonio.run.open_rig import open_rig
from gonio.run.record.store import Store, StoreError
from gonio.run.start import resume, start
from sim.wire.line import Wire
from tests.nursery import Nursery
from tests.self_kill import WHERE
from tests.test_kill import contents, stored
from tests.wire.lab import WIRE, Lab

N = 120


@pytest.fixture(scope="module")
def nursery():
    n = Nursery("drivers.rig")
    yield n
    n.close()


@pytest.fixture(scope="module")
def whole(nursery, tmp_path_factory):
    """A run that nothing happened to."""
    folder = tmp_path_factory.mktemp("whole")
    lab = Lab(folder)
    nursery.start(*lab.acquire(N, folder / "run"))
    assert nursery.wait()[0] == 0
    lab.close()
    return contents(folder / "run")


@pytest.fixture
def lab(tmp_path):
    lab = Lab(tmp_path)
    yield lab
    lab.close()


def same(a, b):
    return all(np.array_equal(a[k], b[k], equal_nan=a[k].dtype.kind == "f") for k in a)


def test_the_host_is_killed_and_the_devices_live_on(lab, nursery, whole, tmp_path):
    """Found again as they were left, in whatever state: every register is as it should be before anything moves."""
    run, rng = tmp_path / "run", np.random.default_rng(1)
    command, before = lab.acquire(N, run), 0
    for k in range(6):
        goal = before + int(rng.integers(1, 15))
        where = WHERE[int(rng.integers(len(WHERE)))]
        nursery.start(*command, **({"writes": [150 + goal]} if k % 2 else {"measured": goal, "where": where}))
        code, last = nursery.wait()
        assert code == -signal.SIGKILL, last
        assert stored(run) >= before
        before = stored(run)
        with lab.emulators.server.lock:
            servo = lab.emulators.servos[1 + k % 4]
            if k == 1:
                servo.power_on()  # its supply dipped while nobody watched
            if k == 3:
                servo.put(64, 0)
                servo.put(t.OPERATING_MODE.address, 4)
                servo.put(t.SHUTDOWN.address, 0)
        command = ["resume", run, "--no-post"]
    nursery.start(*command)
    code, last = nursery.wait()
    assert code == 0, last
    for servo in lab.emulators.servos.values():
        expected = {t.OPERATING_MODE: 3, t.DRIVE_MODE: t.TIME_BASED, t.SHUTDOWN: t.SHUTDOWN_MASK, t.TORQUE: 1}
        assert {r: servo.get(r.address) for r in expected} == expected
        assert servo.get(t.WATCHDOG.address) == 25 and servo.get(t.POSITION_I_GAIN.address) == t.I_GAIN
    assert not lab.lit and lab.still()
    assert same(whole, contents(run))


def test_no_space_for_the_run_file(lab, nursery, whole, tmp_path):
    """The kernel refuses to let it grow: one line, light off, motors at rest; with space again the run goes on."""
    run = tmp_path / "run"
    nursery.start(*lab.acquire(N, run), limit=20)
    code, last = nursery.wait()
    assert code == 2 and "run.sqlite: " in last and "free some space, then `gonio resume`" in last
    assert not lab.lit and lab.still()
    n = stored(run)
    assert 20 <= n < N
    nursery.start("resume", run, "--no-post")
    code, last = nursery.wait()
    assert code == 0, last
    assert same(whole, contents(run))


def material(n, **plan):
    return Material.model_validate(
        {
            "name": "felt",
            "channels": 3,
            "sampler": {"proposal": "pss_simple", "chains": 16},
            "budget": {"measurements": n},
            "plan": plan,
        }
    )


def wire_run(folder, monkeypatch, n=80, **plan):
    """A run on a wire rig that stays at hand, and the rig."""
    for place in ("gonio.run.prepare", "gonio.run.start"):
        monkeypatch.setattr(f"{place}.find_truth", lambda *_: (Lambert([0.3, 0.2, 0.1]), "felt"))
    run = start(material(n, **plan), WIRE, folder)
    rig = open_rig(WIRE, run.truth, run.config.material.seed, plan=run.config.material.plan, isotropic=True)
    return run, rig


@pytest.mark.parametrize("overlap", [False, True])
def test_sqlite_says_full(tmp_path, monkeypatch, overlap):
    """As on a disk without a free block: what could not be stored is not half stored, and is measured again."""
    run, rig = wire_run(tmp_path / "whole", monkeypatch, overlap=overlap)
    run(rig=rig)
    run.close()
    rig.close()
    run, rig = wire_run(tmp_path / "torn", monkeypatch, overlap=overlap)
    db = run.store._db
    begun = [0]

    def watch(progress):
        if progress.measured == 30:
            pages = db.execute("PRAGMA page_count").fetchone()[0]
            db.execute(f"PRAGMA max_page_count = {pages + 1}")
            begun[0] = progress.measured

    with pytest.raises(StoreError, match="full; free some space, then `gonio resume`"):
        run(watch=watch, rig=rig)
    assert begun == [30]
    servos = rig.emulators.servos.values()
    assert all(s.get(116) == round(s.position(rig.clock.now() + 100)) for s in servos)
    run.close()
    rig.close()
    assert not rig.emulators.light.lamp.lit
    kept = contents(tmp_path / "torn")
    assert 30 <= len(kept["m_id"]) < 80
    with Store.open(tmp_path / "torn", write=False) as store:
        done = store.kept()["done"]
    assert done == len(kept["m_id"]), "the state is not that of the last measurement stored"
    run = resume(tmp_path / "torn")
    run()
    run.close()
    assert same(contents(tmp_path / "whole"), contents(tmp_path / "torn"))


def jumping(monkeypatch):
    """The machine's wall clock is set back and forth by hours all the time; the monotonic one is not."""
    rng, real = np.random.default_rng(2), time.time
    monkeypatch.setattr(time, "time", lambda: real() + float(rng.uniform(-36_000, 36_000)))


def test_the_wall_clock_is_set_back_and_forth(tmp_path, monkeypatch):
    run, rig = wire_run(tmp_path / "run", monkeypatch)
    jumping(monkeypatch)
    rig.emulators.lines["stage"].wire = Wire(lost_packet=0.01, seed=1)  # so that there is something to wait for
    began, lost = time.monotonic(), rig.emulators.lines["stage"].wire
    run(rig=rig)
    assert lost.count > 0 and rig.stage.bus.failures < 2 * lost.count + 5, "timeouts were misjudged"
    rig.emulators.lines["stage"].wire = Wire()
    with run.store as store:
        assert len(store.measured().id) == 80 and (np.diff([e[0] for e in store.events()]) >= 0).all()
        order = [r["counter"] for r in store.raw()]
        assert order == sorted(order) and store.measured().wall_s.max() <= time.monotonic() - began + 60
    rig.close()


def test_timeouts_by_the_wall_clock_would_misfire(tmp_path, monkeypatch):
    """Negative control: the SDK's own clock in place of ours."""
    from dynamixel_sdk import PortHandler

    from drivers.dynamixel.port import Port

    run, rig = wire_run(tmp_path / "run", monkeypatch)
    monkeypatch.setattr(Port, "getCurrentTime", PortHandler.getCurrentTime)
    monkeypatch.setattr("drivers.dynamixel.bus.TRIES", 50)
    jumping(monkeypatch)
    for _ in range(2000):  # a reply that is there already is read even so
        rig.stage.states()
        if rig.stage.bus.failures:
            break
    assert rig.stage.bus.failures > 0
    monkeypatch.undo()
    run.close()
    rig.close()


def pairs(n):
    rng = np.random.default_rng(0)
    wi, wo = (from_angles(np.arccos(rng.uniform(0.1, 1, n)), rng.uniform(-np.pi, np.pi, n)) for _ in range(2))
    ok = ((wi - wo) ** 2).sum(1) > 0.2**2
    return wi[ok], wo[ok], np.arange(ok.sum())


def gather(visits):
    seen = list(visits)
    order = np.argsort(np.concatenate([v.ids for v in seen]))
    return {k: np.concatenate([getattr(v, k) for v in seen])[order] for k in ("ids", "wi", "wo", "f")}


@pytest.mark.parametrize("late_s", [0.02, 0.045, 0.08, 0.13, 0.3])
def test_replies_that_come_too_late_are_taken_for_no_other(late_s):
    """Later than the timeout, later than the silence after it: into the middle of the next transaction.

    Where a wire that is later still makes the driver give up, it says so, and has measured nothing wrong.
    """
    wi, wo, ids = pairs(70)
    rig = open_rig(WIRE, Lambert([0.3, 0.2, 0.1]), 1, isotropic=True)
    clean = gather(rig.visit(wi, wo, ids))
    rig.close()
    rig = open_rig(WIRE, Lambert([0.3, 0.2, 0.1]), 1, isotropic=True)
    seen, lines = [], rig.emulators.lines.values()
    for k, line in enumerate(lines):
        line.wire = Wire(late=0.02, late_s=late_s, seed=k)
    try:
        for v in rig.visit(wi, wo, ids):
            seen.append(v)
    except DeviceFault as e:
        assert "no reply" in str(e) or (late_s > 0.1 and "no answer" in str(e)), e
    count = sum(line.wire.count for line in lines)
    for line in lines:
        line.wire = Wire()
    rig.emulators.server.send_late()
    left = ~np.isin(ids, [v.ids[0] for v in seen])
    seen += rig.visit(wi[left], wo[left], ids[left])
    rig.close()
    assert count > 5 or left.any()
    late = gather(seen)
    for k in clean:
        np.testing.assert_array_equal(clean[k], late[k])


def test_a_stop_is_obeyed_within_a_few_packets():
    """As slow as life, the arms on their way: counted in transactions, which no busy machine can stretch."""
    rig = open_rig(WIRE.model_copy(update={"clock_scale": 1.0}), Lambert([0.3, 0.2, 0.1]), 1, isotropic=True)
    try:
        servos = rig.emulators.servos
        goal = rig.envelope.snap(rig.stage.pose() + np.radians([-40.0, 60, 30, 60]))
        moving, begun = threading.Thread(target=rig._go, args=(goal,)), threading.Event()
        line = rig.emulators.lines["stage"]
        line.plans[line.packets + 12] = begun.set  # goals given and read back, and a few polls on the way
        moving.start()
        assert begun.wait(60)
        with rig.emulators.server.lock:
            rig.emulators.bus.log = log = []
            asked, before = rig.clock.now(), rig.stage.bus.failures
            at_first = [s.position(asked) for s in servos.values()]
        rig.stop()
        obeyed, packets = rig.clock.now(), len(log)
        again = rig.stage.bus.failures - before  # replies that a busy machine made too late, asked for once more
        log = [entry for entry in log if entry[1] != 1]  # without the pings that come with that
        order = log.index((254, 131))
        # one under way, where they are, the order, and whether it was taken
        assert order + 2 <= 4 + again and (254, 130) in log[order + 1 :], log
        # the thread that moves them may have a poll under way, sees the stop too and says the same once more: no more
        assert len(log) <= order + 2 + 1 + 3 + again and set(log) == {(254, 130), (254, 131)}, log
        between = []
        for s, first in zip(servos.values(), at_first):
            assert s._until < obeyed + 0.05, "still moving 50 ms later"
            between.append((min(first, s._from) - 1, max(first, s._from) + 1))
            assert between[-1][0] <= s._to <= between[-1][1], "went on, or farther back"
        moving.join()
        # told once more to stay where they are while they come back from where the order met them, they stay there
        assert all(low <= s._to <= high for s, (low, high) in zip(servos.values(), between)), "moved after the stop"
        print(f"stopped in {1000 * (obeyed - asked):.1f} ms, {packets} packets")
    finally:
        rig.close()


@pytest.mark.slow
@pytest.mark.parametrize("twice", [False, True])
def test_ctrl_c_at_any_moment(tmp_path, nursery, twice):
    """Once: after the measurement under way. Twice, or thrice in a hurry: at once. Nothing moves when it has ended."""
    lab, rng = Lab(tmp_path, speed=400.0), np.random.default_rng(7 + twice)
    try:
        command, run = lab.acquire(10**6, tmp_path / "run"), tmp_path / "run"
        for k in range(6):
            first = int(rng.integers(200, 400))
            moments = [first, first + 1 + k % 3, first + 3 + k] if twice else [first]
            nursery.start(*command, writes=moments, signal=int(signal.SIGINT))
            code, last = nursery.wait()
            assert lab.still(), "the prompt is back and something moves"
            at = [s.position(lab.emulators.clock.now()) for s in lab.emulators.servos.values()]
            assert code == 130 and "gonio resume" in last, last
            assert not lab.lit
            assert at == [s.position(lab.emulators.clock.now()) for s in lab.emulators.servos.values()]
            command = ["resume", run, "--no-post"]
    finally:
        lab.close()
