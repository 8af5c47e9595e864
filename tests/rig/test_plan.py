"""Tours: everything is visited once, poses show what was asked, and each switch saves time."""

from itertools import pairwise

import numpy as np
import pytest

from gonio.config import load_config
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.geometry import from_angles, from_half_diff
from gonio.rig.build import envelope_of, park_pose
from gonio.rig.motion.plan import Planner
from gonio.rig.motion.tour import or_opt, two_opt
from tests.conftest import ROOT

SIM = load_config(ROOT / "configs/rigs/sim.yaml", RigConfig)
IDEAL = load_config(ROOT / "configs/rigs/ideal.yaml", RigConfig)


def reachable_pairs(envelope, n, seed=0):
    u = np.random.default_rng(seed).random((4 * n, 3))
    wi, wo = from_half_diff(np.arccos(np.sqrt(u[:, 0])), 0, np.arcsin(np.sqrt(u[:, 1])), np.pi * u[:, 2])
    ok = np.flatnonzero(envelope.reachable(wi, wo))[:n]
    return wi[ok], wo[ok]


def drive(config, plan, isotropic, wi, wo):
    tours = list(Planner(envelope_of(config), plan, isotropic).tours(wi, wo, park_pose(config)))
    return tuple(np.concatenate([getattr(t, k) for t in tours]) for k in ("which", "poses", "seconds"))


@pytest.mark.parametrize("config", [SIM, IDEAL], ids=["sim", "ideal"])
@pytest.mark.parametrize("tour", [True, False])
@pytest.mark.parametrize("branches", [True, False])
def test_every_pair_is_visited_once_and_shown(config, tour, branches):
    envelope = envelope_of(config)
    wi, wo = reachable_pairs(envelope, 150)
    which, poses, seconds = drive(config, PlanConfig(tour=tour, branches=branches, window=64), False, wi, wo)
    assert sorted(which) == list(range(150)) and (tour or list(which) == list(range(150)))
    assert envelope.inside(poses).all() and np.isfinite(seconds).all()
    a, b = envelope.kinematics.forward(poses)
    error = max(np.abs(a - wi[which]).max(), np.abs(b - wo[which]).max())
    assert error < 1e-12 if config is IDEAL else 1e-6 < error < 2 * 2 * np.pi / 4096


def test_each_switch_saves_time():
    wi, wo = reachable_pairs(envelope_of(SIM), 300)
    off = PlanConfig(branches=False, tour=False, free_azimuth=False)
    plans = [
        off,
        PlanConfig(tour=False, free_azimuth=False),
        PlanConfig(tour=False),
        PlanConfig(),
        PlanConfig(reciprocity=True),
    ]
    spent = [drive(SIM, p, True, wi, wo)[2].sum() for p in plans]
    assert all(b < a for a, b in pairwise(spent)), spent
    assert spent[3] < spent[0] / 2.5, spent


def test_same_tour_every_time():
    wi, wo = reachable_pairs(envelope_of(SIM), 200)
    for a, b in zip(drive(SIM, PlanConfig(), True, wi, wo), drive(SIM, PlanConfig(), True, wi, wo)):
        assert np.array_equal(a, b)


def test_improvements_keep_a_permutation_and_never_lengthen():
    for seed in range(20):
        x = np.random.default_rng(seed).random((40, 2))
        cost = np.abs(x[:, None] - x).max(-1)
        length = lambda t, cost=cost: cost[t[:-1], t[1:]].sum()
        order = np.arange(40)
        for step in (two_opt, or_opt):
            better = step(cost, order)
            assert sorted(better) == list(range(40)) and better[0] == 0
            assert length(better) <= length(order) + 1e-12
            order = better
        assert length(order) < 0.4 * length(np.arange(40))


def test_stay_out_and_limits_are_part_of_the_support():
    envelope = envelope_of(SIM)
    theta = np.radians([30.0, 30, 30, 88.5, 30])
    wi = from_angles(theta, 0)
    wo = from_angles(np.radians([30.0, 37.9, 38.5, 10, 95]), 0)
    assert envelope.reachable(wi, wo).tolist() == [False, False, True, False, False]


def test_cable_wrap_is_used_the_short_way():
    axes = {**SIM.axes, "azimuth": SIM.axes["azimuth"].model_copy(update={"lower_deg": -270.0, "upper_deg": 270.0})}
    config = SIM.model_copy(update={"axes": axes})
    wi, wo = from_angles(np.radians([40.0]), 0), from_angles(np.radians([60.0]), np.radians([-170.0]))
    start = np.radians([40.0, 0, 60, 170])
    plan = PlanConfig(free_azimuth=False)
    tour = next(Planner(envelope_of(config), plan, False).tours(wi, wo, start))
    np.testing.assert_allclose(np.degrees(tour.poses[0]), [40, 0, 60, 190], atol=0.1)
    tour = next(Planner(envelope_of(SIM), plan, False).tours(wi, wo, start))
    assert abs(np.degrees(tour.poses[0, 3])) <= 180


def test_pairs_out_of_reach_are_left_out():
    wi, wo = from_angles([0.5, 0.5], [0, 0]), from_angles(np.radians([89.5, 60]), [0, 0])
    which, _, _ = drive(SIM, PlanConfig(), False, wi, wo)
    assert which.tolist() == [1]
