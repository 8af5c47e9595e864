"""gonio queue: samples one after another, each asked for by its name; nothing of it is lost by a kill."""

import json
import random

import pytest

from gonio.config import ConfigError, Material
from gonio.daemon.queue.entries import MOST, Entries
from gonio.run.record.store import Store
from tests.daemon.conftest import Daemon

SET = ["--set", "budget.measurements=40", "--set", "truth=analytic_gloss", "--set", "sampler.proposal=pss_simple"]


@pytest.fixture
def daemon():
    daemon = Daemon("ideal")
    yield daemon
    daemon.close()


@pytest.fixture(scope="module")
def same_daemon():
    daemon = Daemon("ideal")
    yield daemon
    daemon.close()


def ok(done):
    assert done.returncode == 0, done.stderr
    return done.stdout


def add(daemon, name, *more):
    return ok(daemon.gonio("queue", "add", "analytic_gloss", "--set", f"name={name}", *SET, *more))


def states(daemon):
    return {e["name"]: e["state"] for e in daemon.client.get("/queue").json()["entries"]}


def asks(daemon, name):
    """Wait until the sample is asked for."""
    state = daemon.until(lambda s: (s["job"] or {}).get("asks") == name and s["state"] == "paused")
    assert state["job"]["material"] == name.split()[0]


def idle(daemon):
    return daemon.until(lambda s: s["state"] in ("idle", "fault") and not s["queue"]["active"])


def measured(daemon, folder):
    with Store.open(daemon.runs / folder, write=False) as store:
        return len(store.measured().id), store.get("ended", "")


def test_one_after_another_each_asked_for_by_its_name(daemon):
    add(daemon, "felt", "--set", "sample_id=A7")
    add(daemon, "film")
    assert ok(daemon.gonio("queue", "list")).splitlines()[-1] == "not worked off; `gonio queue run` begins"
    ok(daemon.gonio("queue", "run"))
    asks(daemon, "felt (A7)")
    said = ok(daemon.gonio("status"))
    assert "paused" in said and "put in   felt (A7), then `gonio queue ready`" in said and "1 waiting" not in said
    assert not list(daemon.runs.glob("*/*/run.sqlite")), "nothing is begun before the sample is there"
    assert "measures felt (A7)" in ok(daemon.gonio("queue", "ready"))
    asks(daemon, "film")
    assert states(daemon) == {"felt (A7)": "done", "film": "waiting"}
    ok(daemon.gonio("pause", "--off"))  # the same as `ready`
    idle(daemon)
    listed = json.loads(ok(daemon.gonio("queue", "list", "--json")))
    assert [e["state"] for e in listed["entries"]] == ["done", "done"] and not listed["active"]
    for entry in listed["entries"]:
        assert measured(daemon, entry["run"]) == (40, "budget of 40 measurements")


def test_order_is_the_operators(daemon):
    for name in ("a", "b", "c", "d"):
        add(daemon, name)
    ok(daemon.gonio("queue", "move", 4, 1))
    ok(daemon.gonio("queue", "move", 1, 3))
    said = ok(daemon.gonio("queue", "remove", 2))
    assert [line.split()[2] for line in said.splitlines()[:-1]] == ["d", "a", "c"]
    ok(daemon.gonio("queue", "run"))
    for name in ("d", "a"):
        asks(daemon, name)
        ok(daemon.gonio("queue", "ready"))
    asks(daemon, "c")
    assert states(daemon) == {"d": "done", "a": "done", "c": "waiting"}
    ok(daemon.gonio("queue", "remove", 3))  # while it is asked for
    ok(daemon.gonio("queue", "ready"))
    idle(daemon)
    assert states(daemon) == {"d": "done", "a": "done"} and not list(daemon.runs.glob("c/*"))


def test_killed_while_it_asks_it_asks_again(daemon):
    add(daemon, "felt")
    ok(daemon.gonio("queue", "run"))
    asks(daemon, "felt")
    daemon.kill()
    daemon.start()
    asks(daemon, "felt")
    ok(daemon.gonio("queue", "ready"))
    idle(daemon)
    assert states(daemon) == {"felt": "done"}


@pytest.mark.slow
@pytest.mark.parametrize("end", ["kill", "terminate"])
def test_ended_in_a_run_it_goes_on_with_it_and_does_not_ask(end):
    plan = {"measured": 20, "where": "after"} if end == "kill" else {}
    daemon = Daemon("sim", **plan)
    try:
        add(daemon, "felt")
        add(daemon, "film")
        ok(daemon.gonio("queue", "run"))
        asks(daemon, "felt")
        ok(daemon.gonio("queue", "ready"))
        if end == "terminate":
            # or done with all of it before anybody looked: the next sample is asked for then
            daemon.until(
                lambda s: (
                    ((job := s["job"] or {}).get("progress") or {}).get("measured", 0) >= 5 or job.get("asks") == "film"
                )
            )
            daemon.process.terminate()
        daemon.process.wait(60)
        daemon.start()
        asks(daemon, "film")
        (felt, _) = daemon.client.get("/queue").json()["entries"]
        assert felt["state"] == "done" and measured(daemon, felt["run"])[0] == 40
        assert len(list(daemon.runs.glob("felt/*"))) == 1
        if end == "kill":  # told to end, it may have been done with the run before it heard
            with Store.open(daemon.runs / felt["run"], write=False) as store:
                kinds = [kind for _, kind, _ in store.events()]
            assert [k for k in kinds if k in ("started", "resumed")] == ["started", "resumed"]
    finally:
        daemon.close()


def test_what_cannot_be_measured_is_left_out_of_the_way(daemon):
    add(daemon, "grey", "--set", "channels=[L]")
    add(daemon, "film")
    ok(daemon.gonio("queue", "run"))
    asks(daemon, "film")
    rows = daemon.client.get("/queue").json()["entries"]
    assert rows[0]["state"] == "failed" and "1 named, but the truth" in rows[0]["message"]


def test_a_stop_ends_the_work_not_the_entry(daemon):
    add(daemon, "felt")
    ok(daemon.gonio("queue", "run"))
    asks(daemon, "felt")
    ok(daemon.gonio("stop"))
    idle(daemon)
    assert states(daemon) == {"felt": "waiting"}
    ok(daemon.gonio("queue", "run", "--yes"))
    idle(daemon)
    assert states(daemon) == {"felt": "done"}


def test_a_scan_waits_too(daemon, tmp_path):
    (tmp_path / "list.csv").write_text("theta_i_deg,theta_o_deg\n45,0\n45,30\n")
    add(daemon, "felt", "--scan", tmp_path / "list.csv", "--repeats", 2)
    ok(daemon.gonio("queue", "run", "--yes"))
    idle(daemon)
    (row,) = daemon.client.get("/queue").json()["entries"]
    assert row["scan"] and measured(daemon, row["run"])[0] == 4


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["move", 9], "no entry 9"),
        (["remove", 9], "no entry 9"),
        (["ready"], "no sample is asked for"),
        (["add", "no_material"], "no_material"),
        (["add", "analytic_gloss", "--set", "truth=../../etc/passwd"], "truth"),
        (["add", "analytic_gloss", "--scan", "none.csv"], "none.csv"),
        (["add", "analytic_gloss", "--set", "rig.settle_s=1"], "rig.settle_s"),
    ],
)
def test_mistakes_are_one_line(same_daemon, args, words):
    done = same_daemon.gonio("queue", *args)
    assert done.returncode == 2 and words in done.stderr and "Traceback" not in done.stderr
    assert states(same_daemon) == {}


def test_without_a_daemon(monkeypatch, tmp_path):
    import subprocess
    import sys

    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    command = [sys.executable, "-m", "gonio.cli", "queue", "list"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2 and "no daemon runs" in done.stderr


def test_the_file_is_whole_or_refused(tmp_path):
    path = tmp_path / "queue.json"
    entries = Entries(path)
    for name in ("a", "b"):
        entries.add(Material(name=name, metadata={"x": 1.5, "y": "007"}))
    entries.change(1, state="running", run="a/b")
    entries.work(True, False)
    again = Entries(path)
    assert again.saved == entries.saved and again.next().id == 1
    whole, rng = path.read_bytes(), random.Random(2)
    junk = [b"", b"{", b"}", b"\xff", b"\0", b'"', b"null", b"1e999", b"[" * 50, b"-"]
    for _ in range(300):
        data = bytearray(whole)
        for _ in range(rng.randint(1, 3)):
            k = rng.randrange(len(data) + 1)
            data[k : k + rng.randint(0, 20)] = rng.choice(junk)
        path.write_bytes(bytes(data[: rng.choice([len(data), rng.randrange(len(data) + 1)])]))
        try:
            Entries(path)
        except ConfigError as e:
            assert "\n" not in str(e) and "move it away" in str(e)


def test_a_disk_that_is_full_changes_nothing(tmp_path, monkeypatch):
    entries = Entries(tmp_path / "queue.json")
    entries.add(Material(name="a"))

    def full(path, text):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("gonio.daemon.queue.entries.write_text", full)
    with pytest.raises(ConfigError, match="No space left"):
        entries.add(Material(name="b"))
    assert len(entries.saved.entries) == 1 and MOST >= 100
