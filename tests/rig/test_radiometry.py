"""Counts to f: projection, exposure, linearity, dark, drift, and what each does to sigma."""

import numpy as np
import pytest
from scipy.stats import norm

from calibration.radiometry import measure_reference
from gonio.acquire import acquire
from gonio.brdf.models.lambert import Lambert
from gonio.config import Material, load_config
from gonio.config.loader import parse_config
from gonio.config.plan import PlanConfig
from gonio.config.rig import LightConfig, RigConfig
from gonio.geometry import from_angles
from gonio.mcmc import make_sampler
from gonio.mcmc.target import Target
from gonio.rig.devices import Reading
from gonio.rig.errors import DeviceFault
from gonio.rig.signal.radiometry import Dark, Radiometry
from gonio.run.open_rig import open_rig
from gonio.run.record.store import Store
from tests.conftest import ROOT

SIM = load_config(ROOT / "configs/rigs/sim.yaml", RigConfig)
WI, WO = from_angles([0.5], [0.0])[0], from_angles([1.1], [2.0])[0]


def with_photodiode(config=SIM, **keys):
    return config.model_copy(update={"photodiode": config.photodiode.model_copy(update=keys)})


def reading(value, sigma=0.0, seconds=0.02, **raw):
    return Reading(np.atleast_1d(value), np.atleast_1d(sigma), False, {"exposure_s": seconds, **raw})


def dark(value=0.0, sigma=0.0, seconds=0.02):
    return Dark(np.atleast_1d(value), np.atleast_1d(sigma), seconds)


def pairs(rig, n, seed=5):
    rng = np.random.default_rng(seed)
    wi, wo = (from_angles(np.arccos(rng.random(3 * n)), rng.uniform(-np.pi, np.pi, 3 * n)) for _ in range(2))
    ok = np.flatnonzero(rig.reachable(wi, wo))[:n]
    return wi[ok], wo[ok]


def gather(rig, n):
    seen = list(rig.visit(*pairs(rig, n), np.arange(n)))
    return {k: np.concatenate([getattr(v, k) for v in seen]) for k in ("wi", "wo", "f", "sigma")}


class Sheen:
    """Anything but Lambertian."""

    channels = 1

    def eval(self, wi, wo):
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        return (up * (0.1 + 0.4 * (1 - wo[:, 2]) ** 2 + 0.2 * (wi * wo).sum(1) ** 2))[:, None]


@pytest.mark.parametrize("footprint", ["overfilled", "underfilled"])
def test_the_projection_is_that_of_the_footprint(footprint):
    rig = open_rig(with_photodiode(footprint=footprint), Sheen(), 3)
    got = gather(rig, 200)
    z = (got["f"] - Sheen().eval(got["wi"], got["wo"])) / got["sigma"]
    assert abs(z.mean()) < 4 / np.sqrt(200) and 0.9 < z.std() < 1.1
    other = {"overfilled": "underfilled", "underfilled": "overfilled"}[footprint]
    wrong = open_rig(with_photodiode(footprint=footprint), Sheen(), 3)
    wrong.radiometry = Radiometry(wrong.radiometry.gain, wrong.radiometry.gain_sigma, other)
    got = gather(wrong, 200)
    assert np.median(np.abs(got["f"] / Sheen().eval(got["wi"], got["wo"]) - 1)) > 0.2


def test_f_of_a_reading_by_hand():
    r = Radiometry(np.array([50.0]), np.zeros(1))
    f, sigma = r.reduce(reading(2.0, 0.03), dark(0.5, 0.04), WI, WO, drift=1.25)
    per_f = 0.02 * 1.25 * 50 * np.cos(0.5)
    np.testing.assert_allclose([f[0], sigma[0]], [1.5 / per_f, 0.05 / per_f])
    f, sigma = r.reduce(reading(2.0, 0.03, seconds=0.06), dark(0.5, 0.01), WI, WO)  # a dark of another exposure
    per_f = 0.06 * 50 * np.cos(0.5)
    np.testing.assert_allclose([f[0], sigma[0]], [0.5 / per_f, np.hypot(0.03, 0.03) / per_f])
    np.testing.assert_allclose(r.expected(f, WI, WO, 0.06), 0.5)
    for wi, wo in ((-WI, WO), (WI, -WO)):
        assert np.isnan(r.reduce(reading(2.0), dark(), wi, wo)).all()


def test_sigma_carries_the_drifts_own():
    r = Radiometry(np.array([50.0]), np.zeros(1))
    f, sigma = r.reduce(reading(1.0, 0.03), dark(0.0, 0.0), WI, WO, drift=0.8, drift_sigma=0.8 * 0.04)
    np.testing.assert_allclose(sigma / f, 0.05)
    rig = open_rig(SIM, Lambert([0.3]), 1, plan=PlanConfig(reference_every=5))
    seen, looked = [], set()
    for v in rig.visit(*pairs(rig, 300), np.arange(300)):
        seen.append(v.raw[0]["drift"])
        looked.add((rig.levels.drift, rig.levels.drift_sigma))
    drifts, sigmas = np.array(sorted(looked)[1:]).T  # nothing drifts here: what is seen is the drift's own noise
    assert len(drifts) > 40 and 0.7 < drifts.std() / sigmas.mean() < 1.4


def test_a_reference_point_in_the_dark_is_refused():
    rig = open_rig(SIM, Lambert([1e-9]), 1, plan=PlanConfig(reference_every=5))
    with pytest.raises(DeviceFault, match="reference point is as good as dark; choose another park_deg"):
        gather(rig, 3)
    assert not rig.light.lit


@pytest.mark.parametrize("x", [-0.05, 0.03, 0.1])
def test_linearity_is_undone(x):
    true = np.geomspace(1e-4, 7.9, 50)
    shown = true * (1 + x * true / 8)
    r = Radiometry(np.ones(50), np.zeros(50), linearity=x)
    value, sigma = r.signal(Reading(shown, np.full(50, 0.01), False, {"full_scale": [8.0] * 50}))
    np.testing.assert_allclose(value, true, rtol=1e-12)
    np.testing.assert_allclose(sigma, 0.01 / (1 + 2 * x * true / 8), rtol=1e-12)
    plain = Radiometry(np.ones(50), np.zeros(50))
    assert np.abs(plain.signal(Reading(shown, shown, False, {"full_scale": [8.0] * 50}))[0] / true - 1).max() > 0.02


def test_the_white_reference_counts_at_the_geometry_used():
    """A standard that is not Lambertian: right by its certificate at 45/0, wrong by a value for another geometry."""
    at = lambda i, o: Sheen().eval(from_angles(np.radians([i]), 0.0), from_angles(np.radians([o]), np.pi))[0]
    rig = open_rig(SIM, Sheen(), 7)
    found = measure_reference(rig, 45.0, 0.0, at(45.0, 0.0))
    np.testing.assert_allclose(found.gain, np.pi / SIM.exposure_s, rtol=3e-3)
    wrong = measure_reference(rig, 45.0, 0.0, at(0.0, 45.0))
    assert abs(wrong.gain[0] / found.gain[0] - 1) > 0.05


def test_negatives_stay_in_the_record_and_count_as_nothing_in_the_chain(tmp_path):
    """A sample that is all but black: its readings scatter about 0, and the record's mean is unbiased."""
    text = "name: soot\nsymmetry: isotropic\nchannels: [L]\ntruth: soot\nbudget: {measurements: 400}\n"
    plain = "plan: {dark_every: 20}\nsampler: {proposal: independence, target: {channels: 0}}\n"
    material = parse_config(text + plain, Material)
    store = Store.create(tmp_path / "run", "", {})
    rig = open_rig(SIM, Lambert([1e-7]), 5, plan=material.plan)
    acquire(make_sampler(material, rig.reachable, lambda *a: None), rig, store, material)
    m = store.measured()
    store.close()
    assert 0.4 < (m.f < 0).mean() < 0.6
    z = m.f / m.sigma
    assert abs(z.mean()) < 0.25
    target = Target(0, 1.0, 0.1, 1)
    assert (target.scalar(m.f) >= 0).all() and np.array_equal(target.scalar(m.f) == 0, m.f[:, 0] <= 0)


@pytest.mark.parametrize(("share", "bias"), [(0.0, 0.399), (1.0, 0.083), (3.0, 0.0004)])
def test_the_bias_of_max_0(share, bias):
    """What the docs say of it: sigma phi(f/sigma) - f Phi(-f/sigma), and the same from readings."""
    assert abs(norm.pdf(share) - share * norm.cdf(-share) - bias) < 6e-4
    x = share + np.random.default_rng(0).standard_normal(1_000_000)
    assert abs(np.maximum(x, 0).mean() - share - bias) < 3e-3


def test_drift_is_undone():
    config = SIM.model_copy(update={"light": LightConfig(drift_per_h=-1.0)})
    rig = open_rig(config, Lambert([0.3]), 1, plan=PlanConfig(reference_every=10))
    got = gather(rig, 200)
    assert abs(np.median(got["f"][-50:, 0]) / (0.3 / np.pi) - 1) < 0.01 and rig.levels.drift < 0.98
