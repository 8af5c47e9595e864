"""The event-model documents of a run, judged by event-model itself."""

import json

import numpy as np
import pytest

import gonio
from gonio.run.record.store import Store

event_model = pytest.importorskip("event_model", reason="in the study extra")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    material = gonio.Material(
        "analytic_gloss", budget={"measurements": 40}, operator="Zoë", sample_id="7", metadata={"batch": "007"}
    )
    return gonio.acquire(material, "sim", tmp_path_factory.mktemp("runs") / "run")


def documents(path):
    return [json.loads(line, parse_constant=pytest.fail) for line in path.read_text(encoding="utf-8").splitlines()]


def test_every_document_is_valid(run, tmp_path):
    found = documents(run.export("events", tmp_path / "e.jsonl"))
    names = [name for name, _ in found]
    assert names == ["start", "descriptor", *["event"] * 40, "stop"]
    for name, document in found:
        event_model.schema_validators[event_model.DocumentNames[name]].validate(document)
    start, stop = found[0][1], found[-1][1]
    assert (
        start["sample"] == {"name": "analytic_gloss", "sample_id": "7", "batch": "007"} and start["operator"] == "Zoë"
    )
    assert stop["exit_status"] == "success" and stop["num_events"] == {"primary": 40} and stop["reason"]
    assert len({d["uid"] for _, d in found}) == 43
    descriptor = found[1][1]
    assert all(set(d["data"]) == set(descriptor["data_keys"]) == set(d["timestamps"]) for n, d in found if n == "event")


def test_they_hold_the_readings(run, tmp_path):
    class Collect(event_model.DocumentRouter):
        rows: list = []

        def event(self, document):
            self.rows.append(document["data"])

    router = Collect()
    for name, document in documents(run.export("events", tmp_path / "e.jsonl")):
        router(name, document)
    with Store.open(run.folder, write=False) as store:
        m = store.measured()
    rows = sorted(router.rows, key=lambda d: d["measurement"])
    assert np.array_equal([r["f"] for r in rows], m.f) and np.array_equal([r["sigma"] for r in rows], m.sigma)
    theta_o = np.radians([r["theta_o_deg"] for r in rows])
    assert np.allclose(np.cos(theta_o), m.seen[:, 5])


def test_the_same_run_gives_the_same_documents(run, tmp_path):
    one, two = (run.export("events", tmp_path / name).read_bytes() for name in "ab")
    assert one == two


def test_what_could_not_be_measured_is_counted(run, tmp_path):
    import shutil
    import sqlite3

    shutil.copytree(run.folder, tmp_path / "run")
    with sqlite3.connect(tmp_path / "run" / "run.sqlite") as db:
        db.execute("UPDATE measurements SET f = ? WHERE id = 3", (np.full(3, np.nan).tobytes(),))
        db.execute("UPDATE meta SET value = '\"\"' WHERE key = 'ended'")
    found = documents(gonio.open_run(tmp_path / "run").export("events"))
    assert found[0][1]["not_measured"] == 1 and found[-1][1]["num_events"] == {"primary": 39}
    assert found[-1][1]["exit_status"] == "abort"
