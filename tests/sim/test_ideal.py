"""The ideal rig: exact values, honest time."""

import numpy as np
import pytest

from gonio.config import ConfigError, load_config
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.geometry import from_angles
from gonio.run.open_rig import open_rig
from sim.sample import Sample
from tests.conftest import ROOT

IDEAL = load_config(ROOT / "configs/rigs/ideal.yaml", RigConfig)


class Smooth:
    """f = 0.1 + (wi . wo)^2 / 10, three channels."""

    channels = 3

    def eval(self, wi, wo):
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        return (up * (0.1 + 0.1 * (wi * wo).sum(-1) ** 2))[:, None] * np.array([1.0, 0.5, 0.25])


def pairs(n):
    rng = np.random.default_rng(5)
    return tuple(from_angles(np.arccos(rng.random(n)), rng.uniform(-np.pi, np.pi, n)) for _ in range(2))


def gather(rig, wi, wo, ids):
    seen = list(rig.visit(wi, wo, ids))
    return {k: np.concatenate([getattr(v, k) for v in seen]) for k in ("ids", "wi", "wo", "f", "sigma", "rig_s")}


@pytest.mark.parametrize("plan", [PlanConfig(), PlanConfig(tour=False, branches=False)])
def test_values_are_the_truth_where_asked(plan):
    wi, wo = pairs(2500)
    rig = open_rig(IDEAL, Smooth(), 0, plan=plan, isotropic=True)
    got = gather(rig, wi, wo, np.arange(1000, 3500))
    back = np.argsort(got["ids"])
    assert np.array_equal(got["ids"][back], np.arange(1000, 3500))
    assert np.array_equal(got["wi"][back], wi) and np.array_equal(got["f"][back], Smooth().eval(wi, wo))
    assert not got["sigma"].any()
    np.testing.assert_allclose(rig.clock.now(), got["rig_s"].sum())
    assert got["rig_s"].min() >= 0.12


def test_out_of_reach_is_nan_and_costs_nothing():
    wi, wo = pairs(3)
    wo = wo * np.array([1, 1, -1.0])
    got = gather(open_rig(IDEAL, Smooth(), 0), wi, wo, np.arange(3))
    assert np.isnan(got["f"]).all() and not got["rig_s"].any() and len(got["ids"]) == 3


def test_resume_goes_on_from_the_same_pose():
    wi, wo = pairs(50)
    a, b = open_rig(IDEAL, Smooth(), 0), open_rig(IDEAL, Smooth(), 0)
    gather(a, wi[:20], wo[:20], np.arange(20))
    b.restore(a.state())
    first, second = (gather(r, wi[20:], wo[20:], np.arange(30)) for r in (a, b))
    assert all(np.array_equal(first[k], second[k]) for k in first) and a.state() == b.state()


def test_stop_ends_the_visit():
    rig = open_rig(IDEAL, Smooth(), 0, plan=PlanConfig(window=10))
    wi, wo = pairs(100)
    visit = rig.visit(wi, wo, np.arange(100))
    next(visit)
    rig.stop()
    assert list(visit) == []


def test_a_simulated_rig_needs_a_truth_and_a_real_one_refuses_it():
    with pytest.raises(ConfigError, match="truth: missing"):
        open_rig(IDEAL, None, 0)


def test_apertures_average_the_lobe():
    class Lobe:
        channels = 1

        def eval(self, wi, wo):
            h = wi + wo
            t2 = (h[:, :1] ** 2 + h[:, 1:2] ** 2) / h[:, 2:] ** 2
            return np.exp(-t2 / 0.05**2)

    wi, wo = from_angles([0.5], [0.0]), from_angles([0.5], [np.pi])
    lit, seen = np.radians([1.0, 1.5])
    rng = np.random.default_rng(0)

    def scatter(w, half, n=200_000):
        # uniform in a disk about w
        r, p = half * np.sqrt(rng.random(n)), rng.uniform(0, 2 * np.pi, n)
        y = np.array([0.0, 1, 0])
        x = np.cross(y, w[0])
        return np.cos(r)[:, None] * w + np.sin(r)[:, None] * (np.cos(p)[:, None] * x + np.sin(p)[:, None] * y)

    light = scatter(wi, lit)
    expected = (light[:, 2:] * Lobe().eval(light, scatter(wo, seen))).mean() / wi[0, 2]
    np.testing.assert_allclose(Sample(Lobe(), lit, seen).eval(wi, wo), expected, rtol=5e-3)
    np.testing.assert_allclose(Sample(Smooth(), lit, seen).eval(wi, wo), Smooth().eval(wi, wo), rtol=2e-3)
    assert np.array_equal(Sample(Lobe()).eval(wi, wo), Lobe().eval(wi, wo))
