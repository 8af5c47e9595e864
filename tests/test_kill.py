"""SIGKILL before, while and after measurements are stored: resumed, the run is the run that was never killed."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from gonio.run.record.store import Store
from tests.nursery import Nursery
from tests.self_kill import WHERE

SETTINGS = ["--set", "name=kill", "--no-post"]


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """A glossy analytic material on file."""
    from gonio.brdf.models.lambert import Lambert
    from gonio.brdf.models.microfacet import Ggx
    from gonio.brdf.models.mixture import Mixture
    from gonio.load import save_brdf

    path = tmp_path_factory.mktemp("truth") / "gloss.npz"
    save_brdf(Mixture([Lambert([0.3, 0.2, 0.1]), Ggx(0.1, None, [0.05, 0.05, 0.05])]), path)
    return path


def acquisition(truth, rig, proposal="auto", measurements=200):
    settings = {"truth": truth, "sampler.proposal": proposal, "budget.measurements": measurements}
    sets = [word for k, v in settings.items() for word in ("--set", f"{k}={v}")]
    return ["acquire", "chm_orange", "--rig", rig, *sets, *SETTINGS]


def gonio(*args, env=None):
    return [sys.executable, "-m", "gonio.cli", *map(str, args)], {**os.environ, "OMP_NUM_THREADS": "1", **(env or {})}


def run(*args):
    command, env = gonio(*args)
    return subprocess.run(command, env=env, capture_output=True, text=True, timeout=300)


def contents(folder):
    with Store.open(folder, write=False) as store:
        m, s = store.measured(), store.steps()
    return {
        **{f"m_{k}": getattr(m, k) for k in ("id", "asked", "seen", "f", "sigma")},
        **{f"s_{k}": v for k, v in s.items()},
    }


def stored(folder) -> int:
    """How many measurements are in the file."""
    try:
        with Store.open(folder, write=False) as store:
            return store._db.execute("SELECT count(*) FROM measurements").fetchone()[0]
    except Exception:  # not made yet
        return 0


@pytest.fixture(scope="module")
def nursery():
    n = Nursery("sim.rig", "sim.ideal")
    yield n
    n.close()


@pytest.mark.parametrize(
    ("rig", "proposal", "measurements", "kills"), [("ideal", "independence", 8000, 20), ("sim", "auto", 800, 10)]
)
def test_killed_thirty_times_and_nothing_lost(tmp_path, truth, nursery, rig, proposal, measurements, kills):
    args = acquisition(truth, rig, proposal, measurements)
    whole, torn = tmp_path / "whole", tmp_path / "torn"
    nursery.start(*args, "--out", whole)
    assert nursery.wait()[0] == 0
    expected = contents(whole)
    rng = np.random.default_rng(5)
    goals = np.sort(rng.choice(np.arange(1, measurements), kills, replace=False))
    seen, command = 0, [*args, "--out", torn]
    for goal in goals.tolist():
        nursery.start(*command, measured=goal, where=WHERE[int(rng.integers(len(WHERE)))])
        code, last = nursery.wait()
        assert code == -signal.SIGKILL, last
        got = contents(torn)
        n = len(got["m_id"])
        assert n >= seen, "a measurement was lost"
        at = np.searchsorted(expected["m_id"], got["m_id"])
        for k in ("m_asked", "m_seen", "m_f", "m_sigma"):
            assert n == 0 or np.array_equal(got[k], expected[k][at], equal_nan=True)
        seen = n
        command = ["resume", torn, "--no-post"]
    assert seen > 0
    nursery.start(*command)
    code, last = nursery.wait()
    assert code == 0, last
    got = contents(torn)
    for k in expected:
        assert np.array_equal(got[k], expected[k], equal_nan=expected[k].dtype.kind == "f"), k


def test_killed_before_the_first_measurement(tmp_path, truth):
    """A folder with nothing measured in it is gone on with like any other."""
    from gonio.run.record.store import Store as S

    args = acquisition(truth, "ideal")
    assert run(*args, "--out", tmp_path / "a").returncode == 0
    text = (tmp_path / "a" / "config.yaml").read_text()
    S.create(tmp_path / "b", text, {}).close()
    assert run("resume", tmp_path / "b", "--no-post").returncode == 0
    a, b = contents(tmp_path / "a"), contents(tmp_path / "b")
    assert all(np.array_equal(a[k], b[k], equal_nan=a[k].dtype.kind == "f") for k in a)


def test_ctrl_c_once_stores_and_exits_130(tmp_path, truth, nursery):
    folder = tmp_path / "r"
    args = acquisition(truth, "ideal", "independence", 10**6)
    nursery.start(*args, "--out", folder, measured=500, where="after", signal=int(signal.SIGINT))
    code, last = nursery.wait()
    assert code == 130 and "resume" in last and "Traceback" not in last
    with Store.open(folder, write=False) as store:
        assert len(store.measured().id) >= 500
