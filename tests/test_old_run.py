"""A run made by version 0.1.0, before the modules were moved, is continued, reported and exported by this one."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from gonio.run.record.store import Store

OLD = Path(__file__).parent / "data" / "run_before_the_move"

SAME = 192


def gonio(*args):
    command = [sys.executable, "-m", "gonio.cli", *map(str, args)]
    done = subprocess.run(command, env={**os.environ, "OMP_NUM_THREADS": "1"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_run_from_before_the_move(tmp_path):
    """180 of its measurements had been made; `whole.npz` is what the same version made of 260.

    Up to where the surrogate of that version first drew, they are the same; from there on this version's draws.
    """
    run = tmp_path / "run"
    shutil.copytree(OLD, run)
    with Store.open(run, write=False) as store:
        before = store.measured()
    said = gonio("resume", run, "--set", "budget.measurements=260")
    assert "from 260 measurements" in said and (run / "report.html").stat().st_size > 10_000
    expected = np.load(run / "whole.npz")
    with Store.open(run, write=False) as store:
        m, s = store.measured(), store.steps()
    n = len(before.id)
    assert n == 180 and len(m.id) == 260
    assert np.array_equal(m.f[:n], before.f) and np.array_equal(m.asked[:n], before.asked)
    # to rounding: another processor's sine may differ in the last bit
    np.testing.assert_allclose(m.f[:SAME], expected["f"][:SAME], rtol=1e-7, atol=1e-12)
    ours = np.stack([s[name] for name in ("chain", "step", "kind", "id", "accepted", "state")], 1).astype(np.int32)
    early = [rows[(rows[:, 3] < SAME) & (rows[:, 5] < SAME)] for rows in (ours, expected["steps"])]
    assert np.array_equal(*early)
    gonio("export", run, "--format", "csv")
    assert len((run / "samples.csv").read_text().splitlines()) > 260


def test_a_run_that_does_not_say_its_target_is_one_of_the_energy(tmp_path):
    """There was only one when it was made; a run of now says what it is."""
    from gonio.run.record.config import read_config, write_config

    config = read_config(Path(__file__).parent / "data" / "run_before_the_move")
    assert config.material.sampler.target.kind == "energy"
    fresh = config.material.sampler.model_validate({"proposal": "auto"})
    write_config(
        tmp_path, config.model_copy(update={"material": config.material.model_copy(update={"sampler": fresh})})
    )
    assert read_config(tmp_path).material.sampler.target.kind == "unknown"
