"""SIGKILL on the wire: the devices are configured again, and the run is the one that was never killed."""

import os
import signal
import time

import numpy as np
import pytest

from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.load import save_brdf
from gonio.run.record.store import Store
from tests.nursery import PRELOAD_WIRE, Nursery
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
    """Measurements stored after each kill. Two of three strike among the measurements, one at any moment at all:
    while the run is opened, the devices are configured, or what was measured is told to the chain again."""
    counts, command = [0], [*args, "--out", torn]
    while len(counts) <= kills:
        pid = nursery.start(*command)
        # no kill may come so late that none is left for the others, however fast the machine
        share = max(1, (MEASUREMENTS - counts[-1]) // (kills + 2 - len(counts)))
        if len(counts) > 1 and len(counts) % 3 == 0:
            moment = time.monotonic() + float(rng.uniform(0, 0.6))
            while time.monotonic() < moment and stored(torn) < counts[-1] + share:
                time.sleep(0.002)
        else:
            goal = counts[-1] + int(rng.integers(1, share + 1))
            while stored(torn) < goal and not nursery.ended(pid):
                time.sleep(0.002)
            time.sleep(float(rng.uniform(0, 0.004)))
        assert not nursery.ended(pid), nursery.wait()
        os.kill(pid, signal.SIGKILL)
        assert nursery.wait()[0] == -signal.SIGKILL
        counts.append(stored(torn))
        command = ["resume", torn, "--no-post"]
    return counts[1:]


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
