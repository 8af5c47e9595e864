"""SIGKILL on the wire: the devices are configured again, and the run is the one that was never killed."""

import signal
import subprocess

import numpy as np
import pytest

from gonio.brdf.lambert import Lambert
from gonio.brdf.microfacet import Ggx
from gonio.brdf.mixture import Mixture
from gonio.load import save_brdf
from tests.test_kill import _wait_for, acquisition, contents, gonio, run

KILLS, MEASUREMENTS = 10, 240


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    path = tmp_path_factory.mktemp("truth") / "gloss.npz"
    save_brdf(Mixture([Lambert([0.3, 0.2, 0.1]), Ggx(0.1, None, [0.05, 0.05, 0.05])]), path)
    return path


def test_killed_ten_times_on_the_wire(tmp_path, truth):
    args = [*acquisition(truth, "wire", "pss_simple", MEASUREMENTS), "--set", "sampler.chains=8"]
    whole, torn = tmp_path / "whole", tmp_path / "torn"
    done = run(*args, "--out", whole)
    assert done.returncode == 0, done.stderr
    expected = contents(whole)
    rng = np.random.default_rng(5)
    seen = 0
    command, env = gonio(*args, "--out", torn)
    for k in range(KILLS):
        process = subprocess.Popen(command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        _wait_for(process, torn, seen + int(rng.integers(1, max(2, (MEASUREMENTS - seen) // (KILLS - k + 1)))), rng)
        assert process.poll() is None, "done before it was killed"
        process.send_signal(signal.SIGKILL)
        process.wait()
        got = contents(torn)
        assert len(got["m_id"]) >= seen, "a measurement was lost"
        seen = len(got["m_id"])
        command, env = gonio("resume", torn, "--no-post")
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    got = contents(torn)
    for k in expected:
        assert np.array_equal(got[k], expected[k], equal_nan=expected[k].dtype.kind == "f"), k
