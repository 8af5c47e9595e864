"""The control thread: it outlives faults, bugs and the web; a stop reaches the motors whatever they do."""

import threading

import pytest

pytest.importorskip("fastapi", reason="needs the extra `daemon`")

from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.daemon import jobs, manual, rig_owner
from gonio.daemon.control import Busy, Control
from gonio.daemon.launch import Web
from gonio.daemon.server import make_app
from gonio.daemon.sockets import SocketsError, hold, listen
from gonio.rig.errors import DeviceFault
from gonio.run.open_rig import open_rig
from tests.daemon.conftest import httpx, material


def control_of(rig):
    return Control(load_config(find_config(rig, "rigs"), RigConfig))


@pytest.fixture
def control():
    c = control_of("ideal")
    yield c
    c.close()


def submit_run(control, folder, measurements=10**6, **sampler):
    m = Material.model_validate(material(measurements, **sampler))
    return control.submit("acquire", lambda: jobs.acquire(control, m, folder))


class Wrapped:
    """A rig that `visit` of which a test replaces."""

    def __init__(self, rig, visit):
        self._rig, self._visit = rig, visit
        self.halted, self.closed = threading.Event(), 0

    def __getattr__(self, name):
        return getattr(self._rig, name)

    def visit(self, wi, wo, ids):
        return self._visit(self, wi, wo, ids)

    def stop(self):
        self.halted.set()

    def close(self):
        self.closed += 1
        self._rig.close()


@pytest.fixture
def rigs(monkeypatch):
    """Set `rigs.visit`; `rigs.opened` are the rigs that were opened since."""

    class Rigs:
        visit = None
        opened: list = []

    Rigs.opened = []

    def opening(*args, **kwargs):
        Rigs.opened.append(Wrapped(open_rig(*args, **kwargs), Rigs.visit))
        return Rigs.opened[-1]

    monkeypatch.setattr(rig_owner, "open_rig", opening)
    return Rigs


def test_stop_reaches_a_moving_rig_before_it_is_answered(control, rigs, tmp_path):
    moving = threading.Event()

    def visit(rig, wi, wo, ids):
        moving.set()
        rig.halted.wait()
        return
        yield

    rigs.visit = visit
    submit_run(control, tmp_path / "r")
    assert moving.wait(60)
    assert control.stop() and rigs.opened[0].halted.is_set()
    assert control.wait(60) and control.board.state()["job"]["code"] == 130


def test_stop_reaches_a_motion_that_was_just_beginning(control, rigs, tmp_path):
    """A rig forgets a stop when it begins a task; the stop is said again until the job has ended."""
    entered, proceed = threading.Event(), threading.Event()

    def visit(rig, wi, wo, ids):
        entered.set()
        proceed.wait()
        rig.halted.clear()
        rig.halted.wait()
        return
        yield

    rigs.visit = visit
    submit_run(control, tmp_path / "r")
    assert entered.wait(60)
    control.stop()
    proceed.set()
    assert control.wait(60) and control.board.state()["job"]["code"] == 130
    assert len(rigs.opened) == 1


def test_after_a_fault_the_rig_is_opened_anew(control, rigs, tmp_path):
    def visit(rig, wi, wo, ids):
        yield from rig._rig.visit(wi[:1], wo[:1], ids[:1])
        raise DeviceFault("light", "hot", "let it cool")

    rigs.visit = visit
    submit_run(control, tmp_path / "r")
    assert control.wait(60)
    state = control.board.state()
    assert state["state"] == "fault" and state["job"]["code"] == 3 and "let it cool" in state["job"]["message"]
    assert rigs.opened[0].closed == 1 and control.owner.rig is None
    rigs.visit = lambda rig, *asked: rig._rig.visit(*asked)
    control.submit("measure", lambda: jobs.by_hand(manual.measure, (10, 0, 30, 180), None))
    assert control.wait(60) and control.board.state()["state"] == "idle" and len(rigs.opened) == 2


def test_a_bug_ends_the_job_and_not_the_thread(control, caplog):
    control.submit("odd", lambda: ((lambda owner: 1 / 0), {}))
    assert control.wait(60)
    job = control.board.state()["job"]
    assert job["code"] == 1 and "ZeroDivisionError" in job["message"] and "a job failed" in caplog.text
    control.submit("even", lambda: ((lambda owner: {}), {}))
    assert control.wait(60) and control.board.state()["job"]["code"] == 0


def test_one_job_at_a_time(control):
    go = threading.Event()
    control.submit("long", lambda: ((lambda owner: go.wait() and {}), {}))
    with pytest.raises(Busy, match="busy with long"):
        control.submit("other", lambda: ((lambda owner: {}), {}))
    assert not control.pause(), "nothing by hand can be paused"
    go.set()
    assert control.wait(60)


def test_stopped_while_paused(control, tmp_path):
    submit_run(control, tmp_path / "r", chains=20)
    while not (control.board.state()["job"].get("progress")):
        pass
    assert control.pause()
    while control.board.state()["state"] != "paused":
        pass
    assert control.stop() and control.wait(60)
    assert control.board.state()["job"]["code"] == 130


def test_the_light_is_off_when_nothing_runs(tmp_path):
    control = control_of("sim")
    try:
        submit_run(control, tmp_path / "r", 20)
        assert control.wait(60) and control.board.state()["job"]["code"] == 0
        assert control.owner.rig.light.power() == 0
    finally:
        control.close()


def test_the_web_hangs_and_dies_and_the_run_does_not_care(control, tmp_path):
    path = tmp_path / "s"
    web = Web([(make_app(control, tmp_path), listen(path))])
    http = httpx.Client(transport=httpx.HTTPTransport(uds=str(path)), base_url="http://g", timeout=60)
    hang, go = threading.Event(), threading.Event()

    def measured():
        return (control.board.state()["job"].get("progress") or {"measured": 0})["measured"]

    def goes_on():
        before = measured()
        while measured() <= before + 50:
            assert not control.wait(0.001), control.board.state()["job"]
        return True

    try:
        assert http.get("/state").json()["state"] == "idle"
        number = submit_run(control, tmp_path / "r", chains=20)
        web.loop.call_soon_threadsafe(lambda: (hang.set(), go.wait()))
        assert hang.wait(60) and goes_on()
        go.set()
        assert http.get("/state").json()["job"]["id"] == number
        web.loop.call_soon_threadsafe(web.loop.stop)  # as an error outside every handler would
        web._thread.join(60)
        assert not web._thread.is_alive() and goes_on()
        web.keep()
        http.close()
        again = httpx.Client(transport=httpx.HTTPTransport(uds=str(path)), base_url="http://g", timeout=60)
        state = again.get("/state").json()
        assert state["job"]["id"] == number and state["state"] == "running"
        again.close()
    finally:
        go.set()
        control.stop()
        web.close()


def test_rigs_on_one_port_exclude_each_other(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    bench = load_config(find_config("bench", "rigs"), RigConfig)
    with (
        hold(bench),
        pytest.raises(SocketsError, match="another process"),
        hold(bench.model_copy(update={"name": "b"})),
    ):
        pass
    with hold(bench.model_copy(update={"name": "b"})):
        pass


def test_a_folder_open_to_others_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "gonio").mkdir(mode=0o755)
    (tmp_path / "gonio").chmod(0o755)
    with pytest.raises(SocketsError, match="0700"), hold(load_config(find_config("sim", "rigs"), RigConfig)):
        pass
