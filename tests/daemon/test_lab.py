"""A daemon on a rig of depth `real`, its ports leading to emulators in this process: they outlive the daemon."""

import json
import signal
import subprocess
import threading

import pytest

from tests.daemon.conftest import Daemon
from tests.daemon.test_daemon import assert_same, contents
from tests.wire.lab import NAME, Lab

N = 60


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


def in_a_move(lab):
    """Until a packet finds the servos on their way."""
    on_the_way = threading.Event()
    receive = lab.emulators.bus.receive

    def listening(data):
        answers = receive(data)
        if moving(lab):
            on_the_way.set()
        return answers

    lab.emulators.bus.receive = listening
    assert on_the_way.wait(60), "nothing ever moves"
    lab.emulators.bus.receive = receive


def test_plugged_out_in_a_move_and_in_again(lab, daemon, whole):
    """Each of its three cables."""
    job, server = acquire(daemon, lab, "r"), lab.emulators.server
    for at, name in ((8, "stage"), (20, "photodiode"), (30, "stage"), (40, "light")):
        daemon.measured(at)
        in_a_move(lab)
        server.unplug(lab.emulators.lines[name])
        server.plug(lab.emulators.lines[name])
    entry = ended(daemon, job)
    assert entry["code"] == 0, entry
    assert_same(whole, contents(daemon.runs / "r"))
    assert not lab.lit


def test_killed_in_a_move_while_somebody_watches(lab, daemon, whole):
    watcher = daemon.spawn("watch", stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert watcher.stdout.readline()
    acquire(daemon, lab, "r")
    seen = daemon.measured(10)["job"]["progress"]["measured"]
    in_a_move(lab)
    daemon.kill()
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
    acquire(daemon, lab, "r")
    daemon.measured(5)
    in_a_move(lab)
    daemon.process.send_signal(signal.SIGTERM)
    assert daemon.process.wait(60) == 0
    assert not moving(lab) and not lab.lit


def test_another_daemon_on_the_same_ports(lab, daemon):
    """By another name the rig is still the same servos."""
    other = json.loads(lab.yaml.read_text()) | {"name": "other"}
    path = lab.yaml.with_name("other.yaml")
    path.write_text(json.dumps(other))
    done = daemon.gonio("daemon", "--rig", path, "--runs", daemon.runs)
    assert done.returncode == 2 and "another process drives it (port-" in done.stderr
    done = daemon.gonio("park", "--rig", path)
    assert done.returncode == 2 and "another process" in done.stderr


def test_a_stop_by_request_reaches_the_motors_within_a_few_packets(tmp_path):
    """As slow as life: counted in packets, which no busy machine can stretch."""
    lab = Lab(tmp_path, speed=60.0)
    daemon = Daemon(lab.yaml, name=NAME)
    try:
        turn = 40
        for _ in range(4):
            job = daemon.client.post("/jobs/jog", json={"axis": "turntable", "degrees": turn}).json()["job"]
            in_a_move(lab)
            lab.emulators.bus.log = log = []
            assert daemon.client.post("/stop").json() == {"done": True}
            lab.emulators.bus.log = None
            assert (254, 131) in log, "the order to stop"
            assert daemon.ended(job)["code"] == 130
            assert not moving(lab)
            turn = -turn
    finally:
        daemon.close()
        lab.close()
