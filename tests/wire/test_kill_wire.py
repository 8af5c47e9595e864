"""SIGKILL on the wire: the devices are configured again, and the run is the one that was never killed."""

import signal

import numpy as np
import pytest

from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.load import save_brdf
from gonio.run.record.store import Store
from tests.nursery import PRELOAD_WIRE, Nursery
from tests.self_kill import WHERE
from tests.test_kill import acquisition, contents, stored

KILLS, MEASUREMENTS = 50, 600


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    path = tmp_path_factory.mktemp("truth") / "gloss.npz"
    save_brdf(Mixture([Lambert([0.3, 0.2, 0.1]), Ggx(0.1, None, [0.05, 0.05, 0.05])]), path)
    return path


@pytest.fixture
def nursery():
    n = Nursery(*PRELOAD_WIRE.split())
    yield n
    n.close()


def arguments(truth):
    return [*acquisition(truth, "wire", "pss_simple", MEASUREMENTS), "--set", "sampler.chains=16"]


def kill_again_and_again(nursery, args, torn, kills, rng) -> list[int]:
    """Measurements stored after each kill. Two of three strike at a measurement, one at a write to a port: while the
    devices are configured, on a move, or in the middle of a reading."""
    goals = np.sort(rng.choice(np.arange(1, MEASUREMENTS - 100), kills, replace=False))
    counts, command = [], [*args, "--out", torn]
    for k, goal in enumerate(goals.tolist()):
        if k % 3 == 1:
            plan = {"writes": [int(rng.integers(1, 300))]}
        else:
            plan = {"measured": goal, "where": WHERE[int(rng.integers(len(WHERE)))]}
        nursery.start(*command, **plan)
        code, last = nursery.wait()
        assert code == -signal.SIGKILL, last
        counts.append(stored(torn))
        command = ["resume", torn, "--no-post"]
    return counts


@pytest.mark.slow
def test_killed_fifty_times_on_the_wire(tmp_path, truth, nursery):
    whole, torn = tmp_path / "whole", tmp_path / "torn"
    nursery.start(*arguments(truth), "--out", whole)
    assert nursery.wait()[0] == 0
    counts = kill_again_and_again(nursery, arguments(truth), torn, KILLS, np.random.default_rng(5))
    assert counts == sorted(counts), "a measurement was lost"
    assert len(set(counts)) > KILLS // 2, "hardly any of them struck among the measurements"
    nursery.start("resume", torn, "--no-post")
    code, last = nursery.wait()
    assert code == 0, last
    expected, got = contents(whole), contents(torn)
    for k in expected:
        assert np.array_equal(got[k], expected[k], equal_nan=expected[k].dtype.kind == "f"), k


def test_a_measurement_lost_would_show(tmp_path, truth, nursery):
    """Negative control: one stored reading changed by one bit, as if it had been made again with other noise."""
    whole, torn = tmp_path / "whole", tmp_path / "torn"
    nursery.start(*arguments(truth), "--out", whole)
    assert nursery.wait()[0] == 0
    kill_again_and_again(nursery, arguments(truth), torn, 1, np.random.default_rng(6))
    with Store.open(torn, write=True) as store:
        (number, f), *_ = store._db.execute("SELECT id, f FROM measurements").fetchall()
        changed = np.frombuffer(f) * 1.5
        store._db.execute("UPDATE measurements SET f = ? WHERE id = ?", (changed.tobytes(), number))
    nursery.start("resume", torn, "--no-post")
    assert nursery.wait()[0] == 0
    expected, got = contents(whole), contents(torn)
    assert not all(np.array_equal(got[k], expected[k], equal_nan=expected[k].dtype.kind == "f") for k in expected)
