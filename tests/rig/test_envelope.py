"""Never a pose outside the limits, never a way into the stay-out cone."""

import os

import numpy as np
import pytest

from gonio.config import load_config
from gonio.config.plan import PlanConfig
from gonio.config.rig import FaultsConfig, RigConfig
from gonio.geometry import from_angles
from gonio.rig.build import envelope_of, gantry_chain, park_pose
from gonio.rig.errors import DeviceFault
from gonio.rig.motion.envelope import Envelope
from gonio.rig.motion.plan import Planner
from gonio.rig.motion.profile import move_time
from gonio.rig.motion.route import route
from gonio.run.open_rig import open_rig
from tests.conftest import ROOT

SIM = load_config(ROOT / "configs/rigs/sim.yaml", RigConfig)
ENVELOPE = envelope_of(SIM)
CONE = np.radians(8)
SPEED, ACC = np.full(4, np.radians(60)), np.full(4, np.radians(120))


def random_poses(n, seed):
    rng = np.random.default_rng(seed)
    poses = ENVELOPE.snap(rng.uniform(ENVELOPE.lower, ENVELOPE.upper, (n, 4)))
    return poses[ENVELOPE.separation(poses) > CONE + 0.01]


def least_separation(a, b, n=100):
    """Along straight moves a to b (M, A), by brute force and by another formula than the envelope's."""
    share = np.linspace(0, 1, n)[:, None, None]
    light, _, detector, azimuth = np.moveaxis(a + share * (b - a), -1, 0)
    cosine = np.cos(light) * np.cos(detector) + np.sin(light) * np.sin(detector) * np.cos(azimuth)
    return np.arccos(np.clip(cosine, -1, 1)).min(0)


def seconds(delta):
    return move_time(delta, SPEED, ACC)


def test_clear_paths_are_clear_and_others_are_not():
    a, b = random_poses(110_000, 1), random_poses(110_000, 2)
    n = min(len(a), len(b), 100_000)
    a, b = a[:n], b[:n]
    clear = ENVELOPE.path_clear(a, b)
    least = np.concatenate([least_separation(a[k : k + 10_000], b[k : k + 10_000]) for k in range(0, n, 10_000)])
    assert least[clear].min() >= CONE
    assert 0.01 < (~clear).mean() < 0.2
    assert least[~clear].max() < CONE + np.radians(1.5)  # nothing is refused that passes well clear


def test_every_way_round_is_clear_and_within_limits():
    a, b = random_poses(4000, 3), random_poses(4000, 4)
    n = min(len(a), len(b))
    blocked = np.flatnonzero(~ENVELOPE.path_clear(a[:n], b[:n]))[:60]
    assert len(blocked) == 60
    for k in blocked:
        way = route(ENVELOPE, a[k], b[k], seconds)
        legs = np.concatenate([a[k][None], way])
        assert np.array_equal(way[-1], b[k]) and ENVELOPE.inside(way).all()
        assert least_separation(legs[:-1], legs[1:], 2000).min() >= CONE


def test_a_way_out_of_the_cone_goes_no_deeper():
    a = np.radians([30.0, 0, 33, 4])
    way = route(ENVELOPE, a, np.radians([-40.0, 10, 20, -60]), seconds)
    legs = np.concatenate([a[None], way])
    assert least_separation(legs[:1], legs[1:2])[0] >= ENVELOPE.separation(a) - 1e-6
    assert least_separation(legs[1:-1], legs[2:]).min() >= CONE


@pytest.mark.parametrize(
    "plan", [PlanConfig(), PlanConfig(tour=False, reciprocity=True), PlanConfig(free_azimuth=False)]
)
def test_plans_stay_within_limits_and_out_of_the_cone(plan):
    """1e5 random pairs in all, many of them at the edge of what can be reached."""
    rng = np.random.default_rng(7)
    n = 40_000 if not plan.tour else 30_000
    theta = np.where(rng.random((2, n)) < 0.2, np.radians(rng.uniform(87, 89, (2, n))), np.arccos(rng.random((2, n))))
    phi = rng.uniform(-np.pi, np.pi, (2, n))
    phi[1] = np.where(rng.random(n) < 0.2, phi[0] + rng.normal(0, 0.1, n), phi[1])
    wi, wo = from_angles(theta[0], phi[0]), from_angles(theta[1], phi[1])
    ok = ENVELOPE.reachable(wi, wo)
    assert 0.5 < ok.mean() < 0.99
    seen = 0
    for tour in Planner(ENVELOPE, plan.model_copy(update={"window": 64}), True).tours(wi, wo, park_pose(SIM)):
        assert (ENVELOPE.inside(tour.poses).all() and ok[tour.which].all()) or not ok[tour.which].all()
        poses = tour.poses[ok[tour.which]]
        assert np.degrees(np.abs(poses[:, [0, 2]])).max() <= 88 and np.degrees(np.abs(poses)).max() <= 180
        assert least_separation(poses, poses, 1).min() >= CONE
        seen += len(tour.which)
    assert seen == ok.sum()  # what is called reachable is


class Flat:
    channels = 1

    def eval(self, wi, wo):
        return np.full((len(wi), 1), 0.3)


PLANS = int(os.environ.get("GONIO_PLANS", "300"))  # of each kind; 17000 makes 1e5 in all


@pytest.mark.parametrize("faults", [FaultsConfig(), FaultsConfig(droop_deg=0.88), FaultsConfig(stuck_axis=0.03)])
@pytest.mark.parametrize("backlash", [0.0, 0.3])
def test_what_a_rig_drives_is_inside_and_clear(faults, backlash):
    """GONIO_PLANS=17000 pytest tests/rig/test_envelope.py -k drives: 1e5 random plans and faults."""
    axes = {k: a.model_copy(update={"backlash_deg": backlash}) for k, a in SIM.axes.items()}
    rig = open_rig(SIM.model_copy(update={"axes": axes, "faults": faults}), Flat(), 2, plan=PlanConfig(tour=False))
    driven, move = [], rig.stage.move

    def spy(pose, deadline):
        driven.append((rig.stage.pose(), np.array(pose)))
        return move(pose, deadline)

    rig.stage.move = spy
    rng = np.random.default_rng(9)
    wi, wo = (from_angles(np.arccos(rng.random(PLANS)), rng.uniform(-np.pi, np.pi, PLANS)) for _ in range(2))
    left = np.flatnonzero(rig.reachable(wi, wo))
    measured, broke = 0, 0
    while len(left):
        count = 0
        try:
            for v in rig.visit(wi[left], wo[left], left):
                count += len(v.ids)
                measured += int(np.isfinite(v.f).all(1).sum())
        except DeviceFault:
            assert rig.light.power() == 0
            broke += 1
            count += 1  # freed by the operator, who leaves this one out
        left = left[count:]
    # a servo that stops short time and again may find no clear way on: better not measured than driven into the cone
    given_up = rig.reachable(wi, wo).sum() - measured - broke
    assert 0 <= given_up <= (PLANS // 500 if faults.droop_deg else 0) and bool(broke) == bool(faults.stuck_axis)
    a, b = (np.array(x) for x in zip(*driven))
    assert ENVELOPE.inside(b).all()
    least = np.concatenate([least_separation(a[k : k + 10_000], b[k : k + 10_000]) for k in range(0, len(a), 10_000)])
    outside = ENVELOPE.separation(a) >= CONE  # a servo that stops short may end inside by itself
    assert least[outside].min() >= CONE
    assert np.all(least[~outside] >= ENVELOPE.separation(a)[~outside] - 1e-6)
    assert outside.all() or faults != FaultsConfig()


def test_a_tilted_rig_keeps_clear_too():
    chain = gantry_chain({"azimuth": (0.02, 0.0, 1.0), "light": (0.0, 1.0, 0.03)})
    envelope = Envelope(chain, ENVELOPE.axes, CONE)
    a, b = random_poses(3000, 5), random_poses(3000, 6)
    n = min(len(a), len(b))
    a, b = a[:n], b[:n]
    apart = (envelope.separation(a) > CONE + 0.01) & (envelope.separation(b) > CONE + 0.01)
    clear = envelope.path_clear(a, b) & apart
    share = np.linspace(0, 1, 50)[:, None, None]
    wi, wo = chain.forward((a + share * (b - a))[:, clear])
    assert np.arccos(np.clip((wi * wo).sum(-1), -1, 1)).min() >= CONE


def test_a_way_by_two_waypoints():
    """An azimuth of 30 degrees leaves little room: one waypoint does not do for this pair."""
    azimuth = SIM.axes["azimuth"].model_copy(update={"lower_deg": -15.0, "upper_deg": 15.0})
    envelope = envelope_of(SIM.model_copy(update={"axes": {**SIM.axes, "azimuth": azimuth}}))
    a, b = envelope.snap(np.radians([[-10.459, 163.652, 0, -2.197], [15.732, -84.199, -2.812, 12.48]]))
    way = route(envelope, a, b, seconds)
    legs = np.concatenate([a[None], way])
    assert len(way) == 3 and envelope.inside(way).all()
    assert least_separation(legs[:-1], legs[1:], 2000).min() >= CONE
