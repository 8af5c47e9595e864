"""End to end over the Unix socket: jobs, events, pause, stop; what happens when somebody dies."""

import json
import signal
import stat
import subprocess

import numpy as np

from gonio.brdf.library import find
from gonio.geometry import from_angles
from gonio.load import load_brdf
from gonio.run.record.store import Store
from tests.daemon.conftest import Daemon, httpx, material


def contents(folder):
    with Store.open(folder, write=False) as store:
        m, s = store.measured(), store.steps()
    return {k: getattr(m, k) for k in ("id", "asked", "seen", "f", "sigma")} | {f"step_{k}": v for k, v in s.items()}


def assert_same(a, b):
    for k, v in a.items():
        assert np.array_equal(v, b[k], equal_nan=v.dtype.kind == "f"), k


def test_a_run_by_request_is_the_run_by_command(daemon):
    """The samples arrive as events, and the chain is bit for bit that of a run without a daemon."""
    job = daemon.acquire("whole", 300)
    rows, states = [], []
    with daemon.client.stream("GET", "/events") as stream:
        name = ""
        for line in stream.iter_lines():
            if line.startswith("event: "):
                name = line[7:]
            elif line.startswith("data: "):
                body = json.loads(line[6:])
                if name == "samples" and body["job"] == job:
                    rows += body["rows"]
                elif name == "state" and body["job"]["id"] == job:
                    states.append(body)
                    if body["job"]["ended"] is not None and len(rows) == 300:
                        break
    assert states[-1]["job"]["code"] == 0 and states[-1]["state"] == "idle"
    assert states[-1]["job"]["progress"]["measured"] == len(rows) == 300
    assert set(states[-1]["pose_deg"]) == {"light", "turntable", "detector", "azimuth"}
    config = daemon.base / "m.yaml"
    config.write_text(json.dumps(material(300)))
    done = daemon.gonio("acquire", config, "--no-daemon", "--no-post", "--out", daemon.base / "alone")
    assert done.returncode == 0, done.stderr
    assert_same(contents(daemon.base / "alone"), contents(daemon.runs / "whole"))


def test_pause_continue_stop_resume(daemon):
    job = daemon.acquire("torn", 100_000)
    daemon.measured(40)
    assert daemon.client.post("/pause").json() == {"done": True}
    paused = daemon.until(lambda s: s["state"] == "paused")
    n = len(contents(daemon.runs / "torn")["id"])
    refused = daemon.client.post("/jobs/park")
    assert refused.status_code == 409 and "busy" in refused.json()["detail"]
    assert daemon.state()["state"] == "paused" and len(contents(daemon.runs / "torn")["id"]) == n
    assert daemon.client.post("/continue").json() == {"done": True}
    daemon.measured(paused["job"]["progress"]["measured"] + 40)
    assert daemon.client.post("/stop").json() == {"done": True}
    assert daemon.ended(job)["code"] == 130
    n = len(contents(daemon.runs / "torn")["id"])
    assert n >= 80
    n += 50  # past the first draws, whose tour depends on the budget
    body = {"run": "torn", "set": [f"budget.measurements={n}"]}
    entry = daemon.ended(daemon.client.post("/jobs/resume", json=body).json()["job"])
    assert entry["code"] == 0, entry
    torn = contents(daemon.runs / "torn")
    assert len(torn["id"]) == n
    daemon.ended(daemon.acquire("untorn", n))
    assert_same(contents(daemon.runs / "untorn"), torn)


def test_by_hand(daemon):
    for kind, body in (("home", None), ("park", None), ("jog", {"axis": "turntable", "degrees": 10})):
        entry = daemon.ended(daemon.client.post(f"/jobs/{kind}", json=body).json()["job"])
        assert entry["code"] == 0, entry
    assert abs(entry["result"]["pose_deg"]["turntable"] - 10) < 0.1
    body = {"theta_i_deg": 30, "theta_o_deg": 10, "truth": "chm_orange"}
    seen = daemon.ended(daemon.client.post("/jobs/measure", json=body).json()["job"])["result"]
    at = [np.radians([seen[f"theta_{k}_deg"], seen[f"phi_{k}_deg"]]) for k in "io"]
    truth = load_brdf(find("chm_orange").path).eval(*[from_angles(theta, phi)[None] for theta, phi in at])[0]
    assert np.all(np.abs(seen["f"] - truth) < 6 * np.array(seen["sigma"]))
    entry = daemon.ended(daemon.client.post("/jobs/jog", json={"axis": "light", "degrees": 200}).json()["job"])
    assert entry["code"] == 4 and daemon.state()["state"] == "fault"
    entry = daemon.ended(daemon.client.post("/jobs/jog", json={"axis": "elbow", "degrees": 2}).json()["job"])
    assert entry["code"] == 2 and "elbow" in entry["message"]


def test_commands_go_through_the_daemon(daemon):
    done = daemon.gonio("acquire", "chm_orange", "--no-post", "--set", "budget.measurements=60")
    assert done.returncode == 0 and "by the daemon" in done.stdout, done.stderr
    assert str(daemon.runs) in done.stdout
    shown = daemon.gonio("watch", "--once").stdout
    assert "measured 60 of 60" in shown and "sim (devices)" in daemon.gonio("status").stdout
    done = daemon.gonio("acquire", "chm_orange", "--no-post", "--out", daemon.base / "elsewhere")
    assert done.returncode == 2 and "keeps its runs in" in done.stderr and not (daemon.base / "elsewhere").exists()
    job = daemon.acquire("hand", 100_000)
    daemon.measured(20)
    assert daemon.gonio("pause").stdout == "pauses\n"
    daemon.until(lambda s: s["state"] == "paused")
    assert daemon.gonio("pause", "--off").stdout == "goes on\n"
    assert "gonio resume" in daemon.gonio("stop").stdout
    assert daemon.ended(job)["code"] == 130
    assert daemon.gonio("jog", "elbow", "5").returncode == 2


def test_check_asks_the_daemon(daemon):
    """What it would refuse is refused in the same words; that the rig is busy is said after the plan."""
    wrong = (
        ["--out", daemon.base / "elsewhere"],
        ["--set", f"truth={daemon.base / 'run'}"],
        ["--set", "channels=[a, b]"],
        ["--set", "rig.settle_s=1"],
    )
    for words in wrong:
        checked, tried = (daemon.gonio(c, "chm_orange", *words) for c in ("check", "acquire"))
        assert checked.returncode == tried.returncode == 2 and checked.stderr == tried.stderr, words
        assert checked.stdout == ""
    job = daemon.acquire("long", 100_000)
    checked, tried = (daemon.gonio(c, "chm_orange") for c in ("check", "acquire"))
    assert checked.returncode == tried.returncode == 2 and checked.stderr == tried.stderr
    assert "busy with acquire" in checked.stderr and "chm_orange, isotropic" in checked.stdout
    daemon.gonio("stop")
    daemon.ended(job)
    daemon.until(lambda s: s["state"] == "idle")
    done = daemon.gonio("check", "chm_orange", "--out", daemon.runs / "new")
    assert done.returncode == 0 and "chm_orange, isotropic" in done.stdout and not (daemon.runs / "new").exists()
    done = daemon.gonio("check", "chm_orange", "--out", daemon.runs / "long")
    assert done.returncode == 2 and "exists already" in done.stderr


def test_second_daemon_refuses(daemon):
    done = daemon.gonio("daemon", "--rig", "sim", "--runs", daemon.runs)
    assert done.returncode == 2 and "another process drives it" in done.stderr
    assert daemon.state()["rig"]["name"] == "sim"


def test_socket_is_the_users_alone(daemon):
    assert stat.S_IMODE(daemon.socket.stat().st_mode) == 0o600
    assert stat.S_IMODE(daemon.socket.parent.stat().st_mode) == 0o700


def test_clients_die_and_the_run_goes_on(daemon):
    """One that acquires, one that watches without reading: both killed."""
    command = ("acquire", "chm_orange", "--no-post", "--set", "budget.measurements=100000")
    before = daemon.last_job()
    with daemon.spawn(*command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as client:
        job = daemon.measured(20, after=before)["job"]
        assert job["kind"] == "acquire" and job["ended"] is None
        with daemon.client.stream("GET", "/events"):
            client.send_signal(signal.SIGKILL)
    state = daemon.measured(job["progress"]["measured"] + 60)
    assert state["job"]["id"] == job["id"] and state["state"] == "running"
    daemon.client.post("/stop")
    daemon.ended(job["id"])


def test_daemon_killed_loses_nothing():
    daemon = Daemon("sim", measured=75, where="between")
    try:
        client = daemon.spawn(
            *(
                "acquire",
                "chm_orange",
                "--no-post",
                "--out",
                str(daemon.runs / "k"),
                "--set",
                "budget.measurements=150",
            ),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        last = daemon.until_gone()["job"] or {}
        seen = (last.get("progress") or {"measured": 0})["measured"]
        assert daemon.process.wait(60) == -signal.SIGKILL
        _, err = client.communicate(timeout=60)
        assert client.returncode == 130 and "does not answer" in err and "Traceback" not in err
        before = contents(daemon.runs / "k")
        assert 75 > len(before["id"]) >= seen, "what was shown was not stored"
        done = daemon.gonio("resume", daemon.runs / "k", "--no-post")
        assert done.returncode == 0, done.stderr
        done = daemon.gonio(
            *("acquire", "chm_orange", "--no-post", "--out", daemon.base / "w", "--set", "budget.measurements=150")
        )
        assert_same(contents(daemon.base / "w"), contents(daemon.runs / "k"))
        daemon.process.stdout.close()
        daemon.start()  # the socket left behind is no obstacle
        assert daemon.state()["state"] == "idle"
    finally:
        daemon.close()


def test_terminated_the_run_is_stored():
    daemon = Daemon("ideal")
    try:
        daemon.acquire("t", 10**6, chains=50)
        seen = daemon.measured(200)["job"]["progress"]["measured"]
        daemon.process.send_signal(signal.SIGTERM)
        assert daemon.process.wait(60) == 0
        assert len(contents(daemon.runs / "t")["id"]) >= seen and not daemon.socket.exists()
        with Store.open(daemon.runs / "t", write=True) as store:  # its lock is free
            assert store.events()[-1][1] == "interrupted"
    finally:
        daemon.close()


def test_token(daemon):
    base, _, token = daemon.url.partition("?token=")
    with httpx.Client() as http:
        for path in ("", "state", "events", "openapi.json", "page/app.js", "nothing", "jobs/home", "stop"):
            for method in ("GET", "POST", "PUT", "OPTIONS"):
                for headers, query in (
                    ({}, ""),
                    ({"Authorization": "Bearer x"}, ""),
                    ({}, "?token="),
                    ({}, "?token=%ff"),
                ):
                    answer = http.request(method, base + path + query, headers=headers)
                    assert answer.status_code == 401, (method, path, query)
        wrong = http.get(base + "state", headers={"Authorization": f"Bearer {token}x"})
        both = http.get(base + "state?token=" + token, headers={"Authorization": "Bearer x"})
        assert wrong.status_code == both.status_code == 401
        assert http.get(base + "state", headers={"Authorization": f"Bearer {token}"}).status_code == 200
        assert http.get(daemon.url).status_code == 200
    assert base.startswith("http://127.0.0.1:") and len(token) >= 32


def test_the_real_drivers_through_a_daemon():
    """Depth `wire`: stopped, gone on with, killed, gone on with: the run is the one that was never touched."""
    daemon = Daemon("wire")
    try:
        job = daemon.acquire("w", 10**5)
        daemon.measured(30)
        assert daemon.client.post("/stop").json() == {"done": True}
        assert daemon.ended(job)["code"] == 130
        devices = {d["name"]: d for d in daemon.state()["devices"]}
        assert devices["stage"]["ok"] and " V, warmest servo " in devices["stage"]["text"]
        n = len(contents(daemon.runs / "w")["id"])
        daemon.client.post("/jobs/resume", json={"run": "w"})
        daemon.measured(n + 30)
        daemon.kill()
        before = contents(daemon.runs / "w")
        assert len(before["id"]) >= n + 30
        n = len(before["id"]) + 100  # past the first draws, whose tour depends on the budget
        done = daemon.gonio("resume", daemon.runs / "w", "--no-post", "--set", f"budget.measurements={n}")
        assert done.returncode == 0, done.stderr
        config = daemon.base / "m.yaml"
        config.write_text(json.dumps(material(n)))
        done = daemon.gonio("acquire", config, "--rig", "wire", "--no-post", "--out", daemon.base / "whole")
        assert done.returncode == 0, done.stderr
        assert_same(contents(daemon.base / "whole"), contents(daemon.runs / "w"))
    finally:
        daemon.close()
