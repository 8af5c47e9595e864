"""Cells of a study: made once, whatever dies."""

import json
import os
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

from gonio.bench.harness import StudyFailed, run_cells
from gonio.bench.harness.cells import Kept, digest
from gonio.config import ConfigError

HERE = Path(__file__).parent


@pytest.fixture(autouse=True)
def importable(monkeypatch):
    """Workers find `cells_to_run` too."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]))
    monkeypatch.syspath_prepend(str(HERE))


def cells(folder, count=5):
    return [{"x": x, "folder": str(folder)} for x in range(count)]


def squares(made):
    return sorted(r["square"] for _, rows in made for r in rows if "square" in r)


def times_made(folder):
    return Counter(int(x) for x in (folder / "made").read_text().split())


@pytest.mark.parametrize("workers", [1, 2])
def test_made_once_and_kept(tmp_path, workers):
    for _ in range(2):
        made = list(run_cells("cells_to_run:square", cells(tmp_path) * 2, tmp_path, workers=workers))
        assert squares(made) == [0, 1, 4, 9, 16]
    assert set(times_made(tmp_path).values()) == {1}
    assert all(rows[0]["x"] == cell["x"] for cell, rows in made)  # a row says whose it is


def test_another_cell_another_name():
    cell = {"x": 1, "models": ["auto"], "n": 20}
    assert digest("a:b", cell) == digest("a:b", dict(reversed(cell.items())))
    names = {
        digest("a:b", cell),
        digest("a:c", cell),
        digest("a:b", {**cell, "n": 21}),
        digest("a:b", {**cell, "n": "20"}),
    }
    assert len(names) == 4
    with pytest.raises(TypeError):
        digest("a:b", {"x": object()})


@pytest.mark.parametrize("spoilt", ["", "{", '{"rows": 3', '{"rows": [], "source": "older code"}'])
def test_what_cannot_be_used_is_made_again(tmp_path, spoilt):
    list(run_cells("cells_to_run:square", cells(tmp_path, 1), tmp_path))
    path = Kept(tmp_path / "cells", "cells_to_run:square").path(cells(tmp_path, 1)[0])
    path.write_text(spoilt)
    assert squares(run_cells("cells_to_run:square", cells(tmp_path, 1), tmp_path)) == [0]
    assert times_made(tmp_path)[0] == 2
    assert json.loads(path.read_text())["rows"]


def test_a_cell_that_fails_is_said_and_not_kept(tmp_path):
    made = []
    with pytest.raises(StudyFailed, match=r"2 of 5 cells failed; the first: x=1 .*ValueError: 1 is odd"):
        for each in run_cells("cells_to_run:odd_ones_fail", cells(tmp_path), tmp_path):
            made.append(each)
    assert squares(made) == [0, 4, 16] and len(made) == 5
    assert len(list((tmp_path / "cells").glob("*.json"))) == 3


def test_a_worker_that_dies_loses_nothing(tmp_path):
    assert squares(run_cells("cells_to_run:dies_at_first", cells(tmp_path), tmp_path, workers=2)) == [0, 1, 4, 9, 16]
    assert len(list((tmp_path / "cells").glob("*.json"))) == 5


def test_a_cell_that_always_kills_its_worker_is_given_up(tmp_path):
    made = []
    with pytest.raises(StudyFailed, match=r"1 of 5 cells failed; the first: x=2 .*its process died, 3 times"):
        for each in run_cells("cells_to_run:always_dies", cells(tmp_path), tmp_path, workers=2):
            made.append(each)
    assert squares(made) == [0, 1, 9, 16]


def test_a_study_that_was_killed_goes_on(tmp_path):
    """The study kills itself after its third cell; those three are not made again."""
    program = (
        "import os, signal\nfrom pathlib import Path\nfrom gonio.bench.harness import run_cells\n"
        f"folder = Path({str(tmp_path)!r})\n"
        "cells = [{'x': x, 'folder': str(folder)} for x in range(5)]\n"
        "for k, _ in enumerate(run_cells('cells_to_run:square', cells, folder)):\n"
        "    if k == 2: os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    assert subprocess.run([sys.executable, "-c", program]).returncode == -signal.SIGKILL
    assert len(list((tmp_path / "cells").glob("*.json"))) == 3
    assert squares(run_cells("cells_to_run:square", cells(tmp_path), tmp_path)) == [0, 1, 4, 9, 16]
    assert set(times_made(tmp_path).values()) == {1}


@pytest.mark.slow
def test_on_dask_a_worker_that_dies_loses_nothing(tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the extra `study`")
    with distributed.LocalCluster(2, threads_per_worker=1, dashboard_address=None) as cluster:
        address = cluster.scheduler_address
        for _ in range(2):
            made = run_cells("cells_to_run:dies_at_first", cells(tmp_path, 8), tmp_path, dask=address)
            assert squares(made) == [x * x for x in range(8)]
    assert len(list((tmp_path / "cells").glob("*.json"))) == 8
    # the other cells of the worker that died may have been on their way back: made again, kept once
    assert sum(times_made(tmp_path).values()) <= 10


@pytest.mark.slow
def test_no_scheduler_is_one_line(tmp_path):
    pytest.importorskip("distributed", reason="needs the extra `study`")
    with pytest.raises(ConfigError, match=r"--dask nowhere:1: no scheduler answers"):
        list(run_cells("cells_to_run:square", cells(tmp_path), tmp_path, dask="nowhere:1"))
