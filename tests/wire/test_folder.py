"""Folders of emulated rigs: those of killed processes are cleared by the next, those of living ones are not."""

import signal
import tempfile

import pytest

from sim.wire import folder as module
from sim.wire.folder import PREFIX, Folder
from tests.nursery import PRELOAD_WIRE, Nursery
from tests.test_kill import acquisition


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_of_a_living_process_it_stays(temporary):
    mine = Folder()
    other = Folder()
    assert mine.path.is_dir() and other.path.is_dir()
    other.close()
    assert mine.path.is_dir() and not other.path.exists()
    mine.close()


def test_of_a_killed_process_it_goes(temporary, tmp_path):
    nursery = Nursery(*PRELOAD_WIRE.split(), env={"TMPDIR": str(temporary)})
    try:
        run = acquisition("analytic_gloss", "wire", "pss_simple", 50)
        nursery.start(*run, "--out", tmp_path / "run", measured=5, where="after")
        assert nursery.wait()[0] == -signal.SIGKILL
    finally:
        nursery.close()
    assert len(list(temporary.glob(f"{PREFIX}*"))) == 1
    mine = Folder()
    assert list(temporary.glob(f"{PREFIX}*")) == [mine.path]
    mine.close()


def test_one_without_a_lock_goes_when_its_terminals_are_gone(temporary):
    old, new = temporary / f"{PREFIX}old", temporary / f"{PREFIX}new"
    for path, target in ((old, "/dev/pts/none"), (new, "/dev/null")):
        path.mkdir()
        (path / "stage").symlink_to(target)
    (temporary / f"{PREFIX}empty").mkdir()  # made a moment ago, by somebody else
    module.clear_orphans()
    assert not old.exists() and new.exists() and (temporary / f"{PREFIX}empty").exists()
