"""Run folders: whole or not there, one writer, readable only as what they are."""

import datetime as dt
import json
import os
import sqlite3
import subprocess
import sys

import numpy as np
import pytest

from gonio.rig.calibration import RadiometryCalibration, save_calibration
from gonio.run.record.store import Store, StoreError


def filled(folder, n=5):
    store = Store.create(folder, "x: 1\n", {"seed": 1})
    rng = np.random.default_rng(0)
    d, f = rng.random((n, 6)), rng.random((n, 3))
    f[0] = np.nan
    store.add(np.arange(n), d, d + 1, f, f / 10, np.zeros(n, bool), (), np.ones(n))
    store.keep({"pose": [1, 2]})
    store.event("started", "here")
    return store, d, f


def test_what_was_stored_comes_back_to_the_bit(tmp_path):
    store, d, f = filled(tmp_path / "run")
    store.close()
    with Store.open(tmp_path / "run", write=False) as again:
        m = again.measured()
        assert np.array_equal(m.asked, d) and np.array_equal(m.seen, d + 1) and np.array_equal(m.f, f, equal_nan=True)
        assert again.kept() == {"pose": [1, 2]} and again.events()[0][1:] == ("started", "here")


def test_an_empty_run_can_be_read(tmp_path):
    Store.create(tmp_path / "run", "", {}).close()
    with Store.open(tmp_path / "run", write=False) as s:
        assert len(s.measured().id) == 0 and len(s.steps()["step"]) == 0


def test_every_addition_is_on_disk_when_it_returns(tmp_path):
    store, _, _ = filled(tmp_path / "run")
    other = sqlite3.connect(tmp_path / "run" / "run.sqlite")
    assert other.execute("SELECT count(*) FROM measurements").fetchone()[0] == 5
    store.close()


def test_folder_that_exists_is_left_alone(tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "mine.txt").write_text("mine")
    with pytest.raises(StoreError, match="exists already"):
        Store.create(tmp_path / "run", "", {})
    assert [p.name for p in (tmp_path / "run").iterdir()] == ["mine.txt"]


def test_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError):
        Store.create(tmp_path / "file" / "run", "", {})


def test_one_writer_at_a_time_and_readers_beside_it(tmp_path):
    store, _, _ = filled(tmp_path / "run")
    with pytest.raises(StoreError, match="in use"):
        Store.open(tmp_path / "run", write=True)
    with Store.open(tmp_path / "run", write=False) as reader:
        assert len(reader.measured().id) == 5
    store.close()
    Store.open(tmp_path / "run", write=True).close()


@pytest.mark.parametrize("make", ["nothing", "newer", "garbage", "other database", "truncated"])
def test_folders_that_are_no_run(tmp_path, make):
    folder = tmp_path / "run"
    if make == "nothing":
        folder.mkdir()
    else:
        store, _, _ = filled(folder, 200)
        store.close()
        path = folder / "run.sqlite"
        if make == "newer":
            db = sqlite3.connect(path)
            db.execute("UPDATE meta SET value = ? WHERE key = 'format'", (json.dumps(99),))
            db.commit()
            db.close()
        elif make == "garbage":
            path.write_bytes(b"not a database" * 1000)
        elif make == "other database":
            path.unlink()
            db = sqlite3.connect(path)
            db.execute("CREATE TABLE t (a)")
            db.commit()
            db.close()
        else:
            path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(StoreError) as e, Store.open(folder, write=True) as store:
        store.measured()
    assert "\n" not in str(e.value) and str(folder) in str(e.value)
    if make == "newer":
        assert "update gonio" in str(e.value)


def test_a_full_disk_is_said_and_loses_nothing(tmp_path):
    """The database may not grow: what SQLite answers is what it answers on a full disk."""
    store, _, _ = filled(tmp_path / "run")
    pages = store._db.execute("PRAGMA page_count").fetchone()[0]
    store._db.execute(f"PRAGMA max_page_count = {pages}")
    d, f = np.ones((500, 6)), np.ones((500, 3))
    with pytest.raises(StoreError, match="full; free some space"):
        store.add(np.arange(100, 600), d, d, f, f, np.zeros(500, bool), (), np.ones(500))
    store._db.close()
    with Store.open(tmp_path / "run", write=False) as again:
        assert len(again.measured().id) == 5


def test_what_could_not_be_stored_is_not_half_stored(tmp_path):
    """The rig's state is that of the last measurement in the file, never one ahead of it."""
    store, _, _ = filled(tmp_path / "run")
    store.keep({"done": 5, "tour": "a"})
    store.commit()
    store.keep({"done": 6, "tour": "a"})
    d, f = np.ones((1, 6)), np.ones((1, 3))
    with pytest.raises(StoreError):
        store.add(np.array([4]), d, d, f, f, np.zeros(1, bool), (), np.ones(1))  # id 4 is there already
    store.close()
    with Store.open(tmp_path / "run", write=True) as again:
        assert again.kept() == {"pose": [1, 2], "done": 5, "tour": "a"}
        again.keep({"done": 6, "tour": "a"})
        assert again.kept()["done"] == 6


def test_a_run_that_never_began_leaves_nothing(tmp_path):
    (tmp_path / "mine").mkdir()
    for folder in (tmp_path / "a" / "b" / "run", tmp_path / "mine" / "run"):
        Store.create(folder, "", {}).discard()
    assert [p.name for p in tmp_path.iterdir()] == ["mine"]
    Store.create(tmp_path / "run", "", {}).close()
    Store.open(tmp_path / "run", write=True).discard()
    assert (tmp_path / "run" / "run.sqlite").exists(), "it was there before"


def test_a_rig_that_is_not_there_leaves_no_run_behind(tmp_path):
    env = {**os.environ, "XDG_RUNTIME_DIR": str(tmp_path)}
    calibration = RadiometryCalibration(
        id="r", date=dt.datetime.now(dt.UTC), rig="bench", gain=(1.0,) * 3, gain_sigma=(0.0,) * 3
    )
    made = save_calibration(calibration, tmp_path / "made")
    sets = ["--set", "truth=null", "--set", f"rig.calibration.radiometry={made}"]
    command = [sys.executable, "-m", "gonio.cli", "acquire", "chm_orange", "--rig", "bench", *sets]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, env=env, timeout=300)
    assert done.returncode == 3 and "is gone" in done.stderr and "no run folder is left" in done.stderr
    assert "Traceback" not in done.stderr and [p.name for p in sorted(tmp_path.iterdir())] == ["gonio", "made"]
