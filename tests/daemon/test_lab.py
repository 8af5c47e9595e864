"""A daemon on a rig of depth `real`, its ports leading to emulators in this process: they outlive the daemon."""

import json
import os
import signal
import subprocess
import threading
from collections import deque

import pytest

from tests.daemon.conftest import Daemon
from tests.daemon.test_daemon import assert_same, contents
from tests.wire.lab import NAME, Lab

N = 60
AT = (12, 30, 45, 60)  # of the 86 lines that a run says to its photodiode: when things happen


@pytest.fixture
def lab(tmp_path):
    lab = Lab(tmp_path)
    yield lab
    lab.close()


@pytest.fixture
def daemon(lab):
    d = Daemon(lab.yaml, name=NAME)
    yield d
    d.close()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A run that nothing happened to."""
    lab = Lab(tmp_path_factory.mktemp("whole"))
    daemon = Daemon(lab.yaml, name=NAME)
    try:
        assert ended(daemon, acquire(daemon, lab, "w"))["code"] == 0
        return contents(daemon.runs / "w")
    finally:
        daemon.close()
        lab.close()


def acquire(daemon, lab, run):
    body = {"material": {**json.loads(lab.material.read_text()), "budget": {"measurements": N}}, "run": run}
    answer = daemon.client.post("/jobs/acquire", json=body)
    assert answer.status_code == 202, answer.text
    return answer.json()["job"]


def ended(daemon, job):
    return daemon.ended(job)


def moving(lab):
    """Whether any servo has more than two counts to go."""
    with lab.emulators.server.lock:
        now = lab.emulators.clock.now()
        return any(abs(s._to - s.position(now)) > 2 for s in lab.emulators.servos.values())


def in_a_move(lab, *strikes):
    """Each of `strikes` (readings, act): acted when a packet finds the servos on their way and so many lines or more
    were said to the photodiode. In the emulators' own thread, so that nothing else happens meanwhile; the event that
    is returned is set after the last."""
    emulators, todo, done = lab.emulators, deque(strikes), threading.Event()
    receive = emulators.bus.receive

    def listening(data):
        answers = receive(data)
        if todo and emulators.lines["photodiode"].packets >= todo[0][0] and moving(lab):
            todo.popleft()[1]()
            if not todo:
                done.set()
        return answers

    emulators.bus.receive = listening
    return done


def test_plugged_out_in_a_move_and_in_again(lab, daemon, whole):
    """Each of its three cables."""
    lines = lab.emulators.lines
    flap = lambda name: lambda: lab.emulators.server.flap(lines[name])
    done = in_a_move(lab, *((at, flap(name)) for at, name in zip(AT, ("stage", "photodiode", "stage", "light"))))
    entry = ended(daemon, acquire(daemon, lab, "r"))
    assert done.is_set(), "not all of them in the run"
    assert entry["code"] == 0, entry
    assert_same(whole, contents(daemon.runs / "r"))
    assert not lab.lit


def test_killed_in_a_move_while_somebody_watches(lab, daemon, whole):
    watcher = daemon.spawn("watch", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert watcher.stdout.readline()
    in_a_move(lab, (AT[1], lambda: os.kill(daemon.process.pid, signal.SIGKILL)))
    acquire(daemon, lab, "r")
    last = daemon.until_gone()
    seen = ((last["job"] or {}).get("progress") or {"measured": 0})["measured"]
    assert daemon.process.wait(60) == -signal.SIGKILL
    _, err = watcher.communicate(timeout=60)
    assert watcher.returncode == 130 and "does not answer" in err and "Traceback" not in err
    before = len(contents(daemon.runs / "r")["id"])
    assert before >= seen
    daemon.process.stdout.close()
    daemon.start()
    job = daemon.client.post("/jobs/resume", json={"run": "r"}).json()["job"]
    assert ended(daemon, job)["code"] == 0
    assert_same(whole, contents(daemon.runs / "r"))
    assert not lab.lit and not moving(lab)


def test_terminated_in_a_move(lab, daemon):
    in_a_move(lab, (AT[0], lambda: os.kill(daemon.process.pid, signal.SIGTERM)))
    acquire(daemon, lab, "r")
    assert daemon.process.wait(60) == 0
    assert not moving(lab) and not lab.lit


def test_another_daemon_on_the_same_ports(lab, daemon):
    """By another name the rig is still the same servos."""
    other = json.loads(lab.yaml.read_text()) | {"name": "other"}
    other["calibration"]["allow_stale"] = True  # its calibrations are of a rig of another name
    path = lab.yaml.with_name("other.yaml")
    path.write_text(json.dumps(other))
    done = daemon.gonio("daemon", "--rig", path, "--runs", daemon.runs)
    assert done.returncode == 2 and "another process drives it (port-" in done.stderr
    done = daemon.gonio("park", "--rig", path)
    assert done.returncode == 2 and "another process" in done.stderr
    for words in (["check"], ["acquire", "--no-post"]):
        done = daemon.gonio(*words, lab.material, "--rig", path, "--out", daemon.runs / "r")
        assert done.returncode == 2 and "another process drives it (port-" in done.stderr
        assert not (daemon.runs / "r").exists()


def test_a_stop_by_request_reaches_the_motors_within_a_few_packets(tmp_path):
    """Once on their way the servos' clock stands until the order to stop has come, however late."""
    lab = Lab(tmp_path)
    daemon = Daemon(lab.yaml, name=NAME)
    clock, bus = lab.emulators.clock, lab.emulators.bus
    now = clock.now

    def stand_still():
        bus.log = log = []
        at = now()
        clock.now = lambda: now() if (254, 131) in log else at

    try:
        for turn in (40, -40, 40, -40):
            on_the_way = in_a_move(lab, (0, stand_still))
            job = daemon.client.post("/jobs/jog", json={"axis": "turntable", "degrees": turn}).json()["job"]
            assert on_the_way.wait(60), "nothing ever moves"
            assert daemon.client.post("/stop").json() == {"done": True}
            assert (254, 131) in bus.log, "the order to stop"
            assert daemon.ended(job)["code"] == 130
            assert not moving(lab)
            clock.now = now
    finally:
        daemon.close()
        lab.close()
