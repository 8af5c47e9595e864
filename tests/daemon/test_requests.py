"""What a request may not do: reach files outside the runs folder, or make the server fail."""

import json
import os

import pytest

pytest.importorskip("fastapi", reason="needs the extra `daemon`")

import warnings

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # its advice on httpx is for its makers
    from fastapi.testclient import TestClient

from gonio.config import ConfigError, load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.daemon.control import Control
from gonio.daemon.request_paths import run_folder, truth_name, weights_file
from gonio.daemon.server import make_app
from tests.daemon.conftest import material


@pytest.fixture
def served(tmp_path):
    """(control, client, runs) of an ideal rig, in this process."""
    control = Control(load_config(find_config("ideal", "rigs"), RigConfig))
    runs = tmp_path / "runs"
    runs.mkdir()
    with TestClient(make_app(control, runs), raise_server_exceptions=False) as client:
        yield control, client, runs
    control.close()


OUTSIDE = [
    "..",
    "../x",
    "a/../../x",
    "/etc",
    "/etc/passwd",
    "a/..",
    ".",
    "",
    "~",
    "a//b",
    "a\\..\\b",
    "x\0y",
    "a\n",
    "ä",
]


@pytest.mark.parametrize("name", OUTSIDE)
def test_no_run_outside(served, name):
    _, client, runs = served
    (runs / "a").mkdir()
    before = sorted(os.walk(runs.parent))
    for path, body in (("acquire", {"material": material(5), "run": name}), ("resume", {"run": name})):
        answer = client.post(f"/jobs/{path}", json=body)
        assert answer.status_code == 422, answer.text
    with pytest.raises(ConfigError):
        run_folder(runs, name)
    assert sorted(os.walk(runs.parent)) == before


def test_no_run_through_a_link(served):
    _, client, runs = served
    elsewhere = runs.parent / "elsewhere"
    elsewhere.mkdir()
    (runs / "link").symlink_to(elsewhere)
    assert client.post("/jobs/acquire", json={"material": material(5), "run": "link/x"}).status_code == 422
    assert client.post("/jobs/resume", json={"run": "link"}).status_code == 422
    assert not list(elsewhere.iterdir())


@pytest.mark.parametrize(
    "truth", ["/etc/passwd", "../secret.npz", "a/../../secret.npz", "secret.npz", "~/x", "x\0y", "link.npz"]
)
def test_no_truth_outside(served, truth, monkeypatch):
    _, client, runs = served
    (runs.parent / "secret.npz").write_bytes(b"not for you")
    (runs / "link.npz").symlink_to(runs.parent / "secret.npz")
    monkeypatch.chdir(runs.parent)
    for path in ("/jobs/acquire", "/check"):
        answer = client.post(path, json={"material": {**material(5), "truth": truth}, "run": "r"})
        assert answer.status_code == 422 and "truth" in answer.json()["detail"]
    body = {"theta_i_deg": 1, "theta_o_deg": 9, "truth": truth}
    assert client.post("/jobs/measure", json=body).status_code == 422
    assert not (runs / "r").exists()


@pytest.mark.parametrize("weights", ["/etc/passwd", "../secret.npz", "link.npz", "none.npz", "x\0y"])
def test_no_weights_outside(served, weights):
    _, client, runs = served
    (runs.parent / "secret.npz").write_bytes(b"not for you")
    (runs / "link.npz").symlink_to(runs.parent / "secret.npz")
    sampler = {"proposal": "flow", "flow": {"weights": weights}}
    answer = client.post("/jobs/acquire", json={"material": {**material(5), "sampler": sampler}, "run": "r"})
    assert answer.status_code == 422 and "sampler.flow.weights" in answer.json()["detail"]
    assert not (runs / "r").exists()
    (runs / "mine.npz").write_bytes(b"")
    assert weights_file(runs, "mine.npz") == weights_file(runs, str(runs.resolve() / "mine.npz"))


def test_no_picture_outside(served):
    _, client, runs = served
    (runs.parent / "picture.npz").write_bytes(b"")
    wanted = material(5)
    wanted.setdefault("sampler", {}).update(proposal="auto", target={"scene": str(runs.parent / "picture.npz")})
    for path in ("/jobs/acquire", "/check", "/queue"):
        answer = client.post(path, json={"material": wanted})
        assert answer.status_code == 422 and "sampler.target.scene" in answer.json()["detail"], answer.text
        assert "a daemon reads files in its runs folder" in answer.json()["detail"]


def test_truth_inside(served):
    _, _, runs = served
    (runs / "t.npz").touch()
    assert truth_name(runs, str(runs.resolve() / "t.npz")) == str(runs.resolve() / "t.npz")
    assert truth_name(runs, "chm_orange") == "chm_orange"


def test_pages_by_name_only(served):
    _, client, _ = served
    for name in ("app.js", "hemisphere.js", "style.css"):
        assert client.get(f"/page/{name}").status_code == 200
    for name in ("index.html", "..%2fserver.py", "%2e%2e/server.py", "%2fetc%2fpasswd", "app.js%00"):
        assert client.get(f"/page/{name}").status_code == 404
    index = client.get("/", params={"token": '"><script>'})
    assert "<script>" not in index.text.replace("<script src", "") and "script-src 'self'" in str(index.headers)


@pytest.mark.parametrize(
    "body", ["{", "[]", "NaN", '{"degrees": NaN, "axis": "light"}', '{"axis": "\\ud800", "degrees": 1}', "\xff"]
)
def test_odd_bodies(served, body):
    control, client, _ = served
    answer = client.post("/jobs/jog", content=body.encode("latin-1"), headers={"content-type": "application/json"})
    assert answer.status_code in (202, 400, 422)
    control.wait(10)
    text = {**material(5), "channels": ["\ud800", "b", "c"]}
    answer = client.post(
        "/jobs/acquire", content=json.dumps({"material": text}), headers={"content-type": "application/json"}
    )
    assert answer.status_code == 422 and "not text" in answer.json()["detail"]


@pytest.mark.parametrize("last", ["", "x", "1:", ":", "1:2:3", "-1:-1", "9" * 40 + ":1", "٣:٣"])
def test_events_begin_anywhere(served, last):
    """Whatever a client says it has seen; the stream never ends, so its first state is enough."""
    import asyncio

    from gonio.daemon.server import _events

    async def first():
        stream = _events(served[0], last)
        text = ""
        while "event: state" not in text:
            text = await anext(stream)
        await stream.aclose()
        return text

    assert '"state": "idle"' in asyncio.run(first())


@pytest.mark.slow
def test_no_500(served):
    """schemathesis over the OpenAPI schema, in process: whatever is sent, the server answers and never fails."""
    schemathesis = pytest.importorskip("schemathesis", reason="needs the extra `dev`")
    from hypothesis import HealthCheck, settings

    control, client, runs = served
    schema = schemathesis.openapi.from_asgi("/openapi.json", client.app)
    seen: dict[str, set[int]] = {}

    def check(case):
        answer = case.call()
        seen.setdefault(case.path, set()).add(answer.status_code)
        assert answer.status_code < 500 or answer.status_code == 503, (case.path, case.body, answer.text)
        control.stop()
        assert control.wait(60)

    for operation in schema.get_all_operations():
        ok = operation.ok()
        deterministic = settings(
            max_examples=25, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck)
        )
        from hypothesis import given

        deterministic(given(case=ok.as_strategy())(check))()
    assert (
        len(seen) == len(client.get("/openapi.json").json()["paths"])
        and 202 in seen["/jobs/park"] | seen["/jobs/measure"]
        and 422 in seen["/jobs/acquire"]
    )
    assert sorted(p.name for p in runs.parent.iterdir()) == ["runs"]
