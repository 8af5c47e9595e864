"""Depth `devices`: the noise is what the YAML says, and belongs to measurements, not to their order."""

import json

import numpy as np
import pytest

from gonio.config import load_config
from gonio.config.plan import PlanConfig
from gonio.config.rig import FaultsConfig, LightConfig, RigConfig
from gonio.geometry import from_angles
from gonio.rig.clock import VirtualClock
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.run.open_rig import open_rig
from sim.photodiode import SimPhotodiode
from tests.conftest import ROOT

SIM = load_config(ROOT / "configs/rigs/sim.yaml", RigConfig)


class Constant:
    channels = 3

    def __init__(self, f):
        self.f = f

    def eval(self, wi, wo):
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        return up[:, None] * np.array([self.f, self.f / 2, self.f / 4])


def changed(**updates):
    return SIM.model_copy(update=updates)


def pairs(rig, n, seed=5):
    rng = np.random.default_rng(seed)
    wi, wo = (from_angles(np.arccos(rng.random(3 * n)), rng.uniform(-np.pi, np.pi, 3 * n)) for _ in range(2))
    ok = np.flatnonzero(rig.reachable(wi, wo))[:n]
    return wi[ok], wo[ok]


def gather(visits):
    seen = list(visits)
    out = {
        k: np.concatenate([getattr(v, k) for v in seen])
        for k in ("ids", "wi", "wo", "f", "sigma", "rig_s", "saturated")
    }
    out["raw"] = [r for v in seen for r in v.raw]
    return out


def reading(signal, number=0, **config):
    photodiode = SIM.photodiode.model_copy(update=config)
    detector = SimPhotodiode(photodiode, lambda: np.full(1, signal), VirtualClock(), 0.02, 1)
    detector.announce(number)
    return detector.read(), detector


def test_noise_of_the_white_diffuser():
    for signal, relative in ((1.0, 0.005), (0.01, np.hypot(0.005 * 0.1, 1e-4) / 0.01), (100.0, 0.0005)):
        r = [reading(signal, k)[0] for k in range(4000)]
        value = np.array([x.value[0] for x in r])
        np.testing.assert_allclose(value.mean() - 1e-3, signal, rtol=5 * relative / np.sqrt(4000))
        np.testing.assert_allclose(value.std() / signal, relative, rtol=0.06)
        np.testing.assert_allclose(np.mean([x.sigma[0] for x in r]), value.std(), rtol=0.06)


def test_ranges_and_saturation():
    for signal, which, saturated in ((7.9, 0, False), (9.0, 1, False), (300.0, 2, False), (8000.0, 2, True)):
        r, detector = reading(signal, shot_noise=0, read_noise=0, dark=0)
        assert r.raw["range"] == [which] and r.saturated is saturated
        if not saturated:
            np.testing.assert_allclose(r.value, signal, atol=0.51 * detector.lsb[which])
        assert detector.clock.now() == 0.02
    detector.scene = lambda: np.ones(1)
    detector.read()
    assert detector.clock.now() == pytest.approx(0.06)  # a change of range costs another reading
    detector.scene = lambda: np.full(1, 100.0)
    detector.expect(np.full(1, 90.0))
    detector.read()
    assert detector.clock.now() == pytest.approx(0.08)  # unless it was expected


def test_f_comes_back_with_its_sigma():
    rig = open_rig(SIM, Constant(0.3), 3)
    got = gather(rig.visit(*pairs(rig, 500), np.arange(500)))
    z = (got["f"] - np.array([0.3, 0.15, 0.075])) / got["sigma"]
    assert abs(z.mean()) < 4 / np.sqrt(z.size) and 0.95 < z.std() < 1.05
    np.testing.assert_allclose(rig.clock.now(), got["rig_s"].sum())
    assert all(r["counts"] and r["pose_rad"] for r in got["raw"])
    json.dumps(got["raw"])


def test_achieved_directions_are_on_counts_and_near():
    rig = open_rig(SIM, Constant(0.3), 3)
    wi, wo = pairs(rig, 50)
    got = gather(rig.visit(wi, wo, np.arange(50)))
    pose = np.array([r["pose_rad"] for r in got["raw"]]) / (2 * np.pi / 4096)
    assert np.abs(pose - np.round(pose)).max() < 1e-9
    assert 1e-6 < np.abs(got["wi"] - wi[got["ids"]]).max() < 2.5e-3
    a, b = rig.envelope.kinematics.forward(np.array([r["pose_rad"] for r in got["raw"]]))
    assert np.array_equal(a, got["wi"]) and np.array_equal(b, got["wo"])


def test_noise_follows_the_id_not_the_order():
    a, b, c = (open_rig(SIM, Constant(0.3), s) for s in (3, 3, 4))
    wi, wo = pairs(a, 40)
    ids = np.arange(100, 140)
    one = gather(a.visit(wi, wo, ids))
    two = gather(v for k in range(39, -1, -1) for v in b.visit(wi[k : k + 1], wo[k : k + 1], ids[k : k + 1]))
    other = gather(c.visit(wi, wo, ids))
    x, y, z = (g["f"][np.argsort(g["ids"])] for g in (one, two, other))
    np.testing.assert_allclose(x, y, rtol=1e-12)
    assert np.abs(x / z - 1).max() > 1e-3


@pytest.mark.parametrize("isotropic", [True, False])
def test_a_resumed_run_is_the_same_to_the_last_bit(isotropic):
    config = changed(light=LightConfig(drift_per_h=0.2))
    plan = PlanConfig(window=32, reference_every=20, dark_every=25)
    wi, wo = pairs(open_rig(SIM, Constant(0.3), 3), 80)
    ids = np.arange(80)
    whole = open_rig(config, Constant(0.3), 3, plan=plan, isotropic=isotropic)
    expected = gather(whole.visit(wi, wo, ids))
    for cut in (1, 31, 32, 50, 79):
        first = open_rig(config, Constant(0.3), 3, plan=plan, isotropic=isotropic)
        visit = first.visit(wi, wo, ids)
        seen = [next(visit) for _ in range(cut)]
        state = json.loads(json.dumps(first.state()))
        second = open_rig(config, Constant(0.3), 3, plan=plan, isotropic=isotropic)
        second.restore(state)
        left = np.setdiff1d(ids, np.concatenate([v.ids for v in seen]))
        got = gather([*seen, *second.visit(wi[left], wo[left], left)])
        assert got["raw"] == expected["raw"]
        assert all(np.array_equal(got[k], expected[k]) for k in ("ids", "wi", "wo", "f", "sigma")), cut
        np.testing.assert_allclose(second.clock.now(), whole.clock.now())


def test_backlash_shows_from_above_only_and_one_sided_approach_hides_it():
    axes = {k: a.model_copy(update={"backlash_deg": 0.5}) for k, a in SIM.axes.items()}
    slope = type("Slope", (), {"channels": 1, "eval": lambda s, wi, wo: np.exp(5 * (wo[:, :1] + wi[:, 1:2]))})()
    quiet = SIM.photodiode.model_copy(update={"shot_noise": 0.0, "read_noise": 0.0})
    config = changed(axes=axes, photodiode=quiet)
    error = {}
    for mode in ("never", "needed", "always"):
        rig = open_rig(config, slope, 0, plan=PlanConfig(one_sided=mode))
        wi, wo = pairs(rig, 60)
        # well above one count, and with room for the way back below
        ok = (slope.eval(wi, wo)[:, 0] * wi[:, 2] > 0.3) & (wi[:, 2] > 0.1) & (wo[:, 2] > 0.1)
        wi, wo = wi[ok], wo[ok]
        got = gather(rig.visit(wi, wo, np.arange(len(wi))))
        error[mode] = np.abs(np.log(got["f"] / slope.eval(got["wi"], got["wo"]))).max(), rig.clock.now()
    assert error["never"][0] > 0.03 and error["needed"][0] < 0.01 and error["always"][0] < 0.01, error
    assert error["never"][1] < error["needed"][1] <= error["always"][1]


def test_drift_is_followed_by_the_reference_point():
    config = changed(light=LightConfig(drift_per_h=-1.0))
    off = {}
    for every in (0, 10):
        rig = open_rig(config, Constant(0.3), 1, plan=PlanConfig(reference_every=every))
        got = gather(rig.visit(*pairs(rig, 200), np.arange(200)))
        off[every] = np.abs(np.median(got["f"][-50:, 0]) / 0.3 - 1)
    assert off[0] > 0.03 and off[10] < 0.01, off


@pytest.mark.parametrize(
    "faults, who",
    [
        (FaultsConfig(silent_detector=1.0), "photodiode"),
        (FaultsConfig(stuck_axis=1.0), "light|turntable|detector|azimuth"),
    ],
)
def test_a_fault_has_a_name_and_puts_the_light_out(faults, who):
    rig = open_rig(changed(faults=faults), Constant(0.3), 1)
    with pytest.raises(DeviceFault, match=who):
        gather(rig.visit(*pairs(rig, 20), np.arange(20)))
    assert not rig.light.lit


def test_droop_is_recorded_as_achieved():
    rig = open_rig(changed(faults=FaultsConfig(droop_deg=0.88)), Constant(0.3), 1)
    wi, wo = pairs(rig, 30)
    got = gather(rig.visit(wi, wo, np.arange(30)))
    away = np.degrees(np.linalg.norm(got["wi"] - wi[got["ids"]], axis=1))
    assert 0.2 < away.max() < 2.0 and np.isfinite(got["f"]).all()


def test_droop_may_be_kept_from_the_chain():
    rig = open_rig(changed(faults=FaultsConfig(droop_deg=0.88), use_achieved=False), Constant(0.3), 1)
    got = gather(rig.visit(*pairs(rig, 30), np.arange(30)))
    assert np.isnan(got["f"]).all(1).mean() > 0.5 and all(r["counts"] for r in got["raw"])
    exact = open_rig(changed(use_achieved=False), Constant(0.3), 1)
    assert np.isfinite(gather(exact.visit(*pairs(exact, 30), np.arange(30)))["f"]).all()


def test_jog_and_drive_keep_to_the_envelope():
    rig = open_rig(SIM, Constant(0.3), 1)
    before = rig.stage.pose()
    np.testing.assert_allclose(rig.jog("turntable", 0.5) - before, [0, 0.5, 0, 0], atol=2e-3)
    for axis, angle in (("light", 3.0), ("light", np.pi / 2)):  # beyond its limit; onto the detector's place
        with pytest.raises(SafetyStop, match="light"):
            rig.jog(axis, angle)
    wi, wo = rig.drive(from_angles([0.3], [0.0]), from_angles([1.0], [2.0]))
    np.testing.assert_allclose([wi[2], wo[2]], np.cos([0.3, 1.0]), atol=2e-3)
    with pytest.raises(SafetyStop, match="out of reach"):
        rig.drive(from_angles([0.3], [0.0]), from_angles([0.3], [0.05]))
    rig.park()
    np.testing.assert_allclose(rig.stage.pose(), np.radians([-45, 0, 45, 0]), atol=2e-3)


def test_nothing_moves_before_homing():
    rig = open_rig(SIM, Constant(0.3), 1)
    rig.stage.homed = False
    with pytest.raises(SafetyStop, match="not homed"):
        gather(rig.visit(*pairs(rig, 2), np.arange(2)))
    assert rig.stage.pose() == pytest.approx(np.radians([-45, 0, 45, 0]), abs=2e-3)


def test_stop_and_close():
    rig = open_rig(SIM, Constant(0.3), 1)
    visit = rig.visit(*pairs(rig, 20), np.arange(20))
    next(visit)
    at = rig.stage.pose()
    rig.stop()
    assert list(visit) == [] and np.array_equal(rig.stage.pose(), at)
    rig.stage.move(np.zeros(4), 60.0)  # a move that was on its way to the stage when the stop came
    assert np.array_equal(rig.stage.pose(), at)
    assert len(list(rig.visit(*pairs(rig, 2), np.arange(2)))) == 2  # a new task moves again
    rig.close()
    assert not rig.light.lit


def test_a_gimbal_measures_too():
    turn = {"lower_deg": -180.0, "upper_deg": 180.0}
    axes = {"yaw": turn, "tilt": turn, "roll": turn, "detector": {"lower_deg": 8.5, "upper_deg": 170.0}}
    config = {"name": "swing", "depth": "devices", "kinematics": {"kind": "gimbal"}, "axes": axes}
    config = RigConfig(**config, park_deg={"detector": 90.0})
    for isotropic in (True, False):
        rig = open_rig(config, Constant(0.3), 1, isotropic=isotropic)
        wi, wo = pairs(rig, 100)
        got = gather(rig.visit(wi, wo, np.arange(100)))
        z = (got["f"] - np.array([0.3, 0.15, 0.075])) / got["sigma"]
        assert np.isfinite(z).all() and np.abs(z).max() < 5
        np.testing.assert_allclose((got["wi"] * got["wo"]).sum(1), (wi * wo).sum(1)[got["ids"]], atol=2e-3)
    axes["detector"] = turn
    with pytest.raises(ValueError, match="through the light"):
        RigConfig(name="x", depth="devices", kinematics={"kind": "gimbal"}, axes=axes)
