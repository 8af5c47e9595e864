"""A daemon in a process of its own, in a runtime folder of the test's own."""

import contextlib
import io
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from tests.conftest import ROOT

pytest.importorskip("fastapi", reason="needs the extra `daemon`")
httpx = pytest.importorskip("httpx", reason="needs the extra `daemon`")


PLANNED = (
    "import json, sys; from tests.self_kill import install; from gonio.cli import main; "
    "install(json.loads(sys.argv.pop(1))); main()"
)


class Daemon:
    """`gonio daemon` on a rig: `client` over its Unix socket, `gonio(...)` in the same surroundings."""

    def __init__(self, rig="sim", tcp=False, name=None, **plan):
        """plan: what the daemon does to itself, as `tests.self_kill.install` takes it."""
        self.base = Path(tempfile.mkdtemp(prefix="gonio-test-"))  # short: a socket's path may have 107 bytes
        self.runs = self.base / "runs"
        (self.base / "run").mkdir(mode=0o700)
        self.env = {**os.environ, "XDG_RUNTIME_DIR": str(self.base / "run"), "OMP_NUM_THREADS": "1"}
        self.rig, self.tcp, self.url = rig, tcp, ""
        self.socket = self.base / "run" / "gonio" / f"{name or rig}.sock"
        self.start(**plan)

    def start(self, **plan):
        port = ["--tcp", "0"] if self.tcp else []
        command = ["daemon", "--rig", str(self.rig), "--runs", str(self.runs), *port]
        words = [sys.executable, "-c", PLANNED, json.dumps(plan), *command]
        self.process = subprocess.Popen(
            words, env=self.env, text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=ROOT
        )
        assert self.process.stdout.readline().startswith("rig"), "the daemon did not start"
        if self.tcp:
            self.url = self.process.stdout.readline().split()[1]
        self.client = httpx.Client(transport=httpx.HTTPTransport(uds=str(self.socket)), base_url="http://g", timeout=60)

    def spawn(self, *args, **kwargs):
        return subprocess.Popen([sys.executable, "-m", "gonio.cli", *args], env=self.env, text=True, **kwargs)

    def gonio(self, *args):
        """The command in this process, as the operator's own: returncode, stdout, stderr."""
        from gonio.cli import main

        out, err = io.StringIO(), io.StringIO()
        with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            patch.setenv("XDG_RUNTIME_DIR", self.env["XDG_RUNTIME_DIR"])
            patch.setattr(sys, "argv", ["gonio", *map(str, args)])
            with pytest.raises(SystemExit) as ended:
                main()
        return subprocess.CompletedProcess(args, ended.value.code, out.getvalue(), err.getvalue())

    def state(self):
        return self.client.get("/state").json()

    def until(self, wanted, seconds=600):
        """The first state, as the daemon tells of its changes, that is `wanted`."""
        state = None
        with self.client.stream("GET", "/events", timeout=seconds) as answer:
            for line in answer.iter_lines():
                if line.startswith("data: ") and "devices" in (told := json.loads(line[6:])):
                    state = told
                    if wanted(state):
                        return state
                elif line.startswith(": still here"):
                    seconds -= 5
                    assert seconds > 0, f"waited in vain; {json.dumps(state)}"
        raise AssertionError(f"the daemon fell silent; {json.dumps(state)}")

    def until_gone(self):
        """The last state that the daemon tells of before it dies."""
        state = {"job": None}
        with contextlib.suppress(httpx.HTTPError), self.client.stream("GET", "/events") as answer:
            for line in answer.iter_lines():
                if line.startswith("data: ") and "devices" in (told := json.loads(line[6:])):
                    state = told
        return state

    def ended(self, job):
        return self.until(lambda s: s["job"]["id"] == job and s["job"]["ended"] is not None)["job"]

    def acquire(self, run, measurements, **sampler):
        body = {"material": material(measurements, **sampler), "run": run}
        answer = self.client.post("/jobs/acquire", json=body)
        assert answer.status_code == 202, answer.text
        return answer.json()["job"]

    def last_job(self):
        """Number of the job that was begun last, 0 before the first."""
        return (self.state()["job"] or {"id": 0})["id"]

    def measured(self, at_least, after=0):
        """Wait until so many measurements have been made by a job later than number `after`; that state."""

        def enough(s):
            job = s["job"] or {"id": 0}
            return job["id"] > after and (job.get("progress") or {"measured": 0})["measured"] >= at_least

        return self.until(enough)

    def kill(self):
        self.process.kill()
        self.process.wait()

    def close(self):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            self.process.wait(60)
        self.process.stdout.close()
        self.client.close()
        shutil.rmtree(self.base)


def material(measurements, **sampler):
    """A material as a client sends it: the fit of chm_orange that ships, or a table of it."""
    chains = {"proposal": "pss_vndf", **sampler}
    return {"name": "m", "truth": "chm_orange", "sampler": chains, "budget": {"measurements": measurements}}


@pytest.fixture(scope="session")
def daemon():
    d = Daemon("sim", tcp=True)
    yield d
    d.close()
