"""Columns of common errors: each is what f would be if the calibration were wrong by one standard deviation."""

import dataclasses
import datetime as dt

import numpy as np
import pytest

from calibration.geometry import Parameters, fit_geometry
from calibration.geometry.fit import calibration_of
from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.budget import Budget, Common
from gonio.budget.angles import Angles
from gonio.budget.strata import STRATA, strata
from gonio.config import load_config
from gonio.config.find import find_config
from gonio.config.rig import Acceptance, RigConfig
from gonio.geometry import from_angles
from gonio.rig.calibration import RadiometryCalibration
from gonio.rig.devices import Reading
from gonio.rig.signal.radiometry import Dark, Radiometry
from tests.calibration.test_mirror_session import WRONG, peaks, truth

SIM = load_config(find_config("sim", "rigs"), RigConfig)
GLOSS = Mixture([Lambert([0.2] * 3), Ggx(0.1, None, [0.5] * 3)])
RADIOMETRY = RadiometryCalibration(
    id="r",
    date=dt.datetime.now(dt.UTC),
    rig="sim",
    gain=(150.0, 160.0, 170.0),
    gain_sigma=(0.9, 0.9, 0.9),
    linearity=0.02,
    linearity_sigma=0.004,
    range_ratios=(1.0, 1.01, 0.99),
    range_ratios_sigma=(0.0, 0.002, 0.003),
    stray=(0.005,) * 3,
    stray_sigma=(0.001,) * 3,
    drift_per_h=0.01,
    drift_per_h_sigma=0.002,
    certificate_u=0.004,
)


def pairs(n=40, seed=0):
    rng = np.random.default_rng(seed)
    draw = lambda: from_angles(np.radians(rng.uniform(0, 70, n)), rng.uniform(-np.pi, np.pi, n))
    return draw(), draw()


def common(**more):
    given = {"config": SIM, "value": GLOSS.eval, "radiometry": RADIOMETRY, "geometry": None, "hours": 0.5}
    return Common(**{**given, "referenced": False, **more})


def reduced(wi, wo, f, **wrong):
    """f as a calibration with something changed would have it, of readings that RADIOMETRY explains."""
    right, p = RADIOMETRY, SIM.photodiode
    full = p.full_scale * p.range_factor ** np.arange(p.ranges)
    seconds = SIM.exposure_s
    light = f * np.array(right.gain) * seconds * wi[2] + np.array(right.stray) * seconds
    k = np.searchsorted(full, light)
    shown = np.array(right.range_ratios)[k] * light * (1 + right.linearity * light / full[k])
    raw = {"exposure_s": seconds, "full_scale": full[k].tolist(), "range": k.tolist()}
    r = dataclasses.asdict(
        Radiometry(
            np.array(right.gain),
            np.zeros(3),
            "overfilled",
            right.linearity,
            None,
            np.array(right.range_ratios),
            np.array(right.stray),
        )
    )
    dark = Dark(np.zeros(3), np.zeros(3), seconds)
    return Radiometry(**{**r, **wrong}).reduce(Reading(shown, 0 * shown, False, raw), dark, wi, wo)[0]


@pytest.mark.parametrize(
    ("part", "wrong"),
    [
        ("gain", {"gain": np.array(RADIOMETRY.gain) - np.sqrt(0.9**2 - (0.004 * np.array(RADIOMETRY.gain)) ** 2)}),
        ("linearity", {"linearity": 0.02 - 0.004}),
        ("ranges", {"ratios": np.array([1.0, 1.01 - 0.002, 0.99 - 0.003])}),
        ("stray", {"stray": np.full(3, 0.005 - 0.001)}),
    ],
)
def test_a_column_is_what_a_wrong_calibration_does(part, wrong):
    wi, wo = pairs()
    f = GLOSS.eval(wi, wo)
    said = np.sqrt((common().columns(wi, wo)[part] ** 2).sum(0))
    for k in range(len(f)):
        right, other = reduced(wi[k], wo[k], f[k]), reduced(wi[k], wo[k], f[k], **wrong)
        np.testing.assert_allclose(right, f[k], rtol=1e-9)
        np.testing.assert_allclose(said[k], np.abs(other / right - 1), rtol=0.06, atol=2e-6)
    assert said.max() > 1e-4 or part == "ranges"


def test_drift_and_certificate():
    wi, wo = pairs()
    assert common().columns(wi, wo)["certificate"] == pytest.approx(0.004)
    assert common().columns(wi, wo)["drift"] == pytest.approx(np.hypot(0.01, 0.002) * 0.25)
    assert "drift" not in common(referenced=True).columns(wi, wo)
    assert common(radiometry=None).left_out and not common(radiometry=None).calibrated


@pytest.fixture(scope="module")
def geometry():
    seen = peaks(60, truth(WRONG))
    fit = fit_geometry([dataclasses.replace(o, sigma=2e-4) for o in seen], Parameters(WRONG))
    return calibration_of(fit, WRONG, True)


def test_angles_by_drawing_other_rigs(geometry):
    """The columns' covariance is that of f cos over rigs drawn from the fit's covariance; half of it is not."""
    wi, wo = pairs(30, 3)
    apart = np.linalg.norm(wi - wo, axis=1) > 0.3
    wi, wo = wi[apart], wo[apart]
    angles = Angles(WRONG, geometry)
    slope, cosine = angles.columns(GLOSS.eval, wi, wo, lambda wi, wo: wi[:, 2])
    said = np.sqrt(((slope + cosine) ** 2).sum(0))[:, 0]
    rng = np.random.default_rng(0)
    light, detector = angles.shifts(wi, wo)
    drawn = []
    for _ in range(400):
        z = rng.standard_normal(len(light))
        moved = [w + np.einsum("k,knx->nx", z, d) for w, d in ((wi, light), (wo, detector))]
        moved = [w / np.linalg.norm(w, axis=1, keepdims=True) for w in moved]
        drawn.append(GLOSS.eval(*moved)[:, 0] * moved[0][:, 2] / (GLOSS.eval(wi, wo)[:, 0] * wi[:, 2]) - 1)
    ratio = np.std(drawn, 0) / said
    assert 0.85 < np.median(ratio) < 1.15 and np.abs(ratio - 1).max() < 0.6
    alone = np.sqrt((cosine**2).sum(0))[:, 0]
    assert np.median(alone / said) < 0.9 or np.median(alone / said) > 1.1


def test_shifts_are_those_of_the_parameters(geometry):
    angles = Angles(WRONG, geometry)
    wi, wo = pairs(20, 4)
    apart = np.linalg.norm(wi - wo, axis=1) > 0.3
    light, detector = angles.shifts(wi[apart], wo[apart])
    assert (
        np.abs(np.einsum("knx,nx->kn", light, wi[apart])).max() < 2e-4
    )  # a turn moves across, not along; poses are whole counts
    size = np.sqrt((light**2).sum((0, 2)) + (detector**2).sum((0, 2)))
    assert 1e-5 < np.median(size) < 0.05
    turned = Angles(WRONG, geometry, isotropic=False).shifts(wi[apart], wo[apart])[0]
    assert np.sqrt((turned**2).sum((0, 2))).max() > 0.05  # the turntable's zero, which no mirror tells


def test_solid_angles_are_the_mean_over_the_cone():
    from sim.sample import Sample

    config = SIM.model_copy(update={"acceptance": Acceptance(light_half_angle_deg=1.5, detector_half_angle_deg=0.0)})
    wi, wo = pairs(50, 5)
    wo[:25] = wi[:25] * [-1, -1, 1]  # at the peak, where it matters
    said = common(config=config, radiometry=None).columns(wi, wo)["solid angles"][0]
    seen = Sample(GLOSS, np.radians(1.5)).eval(wi, wo) / GLOSS.eval(wi, wo) - 1
    peak = np.abs(seen[:25])
    np.testing.assert_allclose(said[:25], peak, atol=0.35 * peak.max())
    assert peak.max() > 0.01


class Known:
    """A BRDF that knows itself to 1 %."""

    channels, eval, sample, pdf = 3, staticmethod(GLOSS.eval), staticmethod(GLOSS.sample), staticmethod(GLOSS.pdf)

    def std(self, wi, wo):
        return 0.01 * GLOSS.eval(wi, wo)

    def interval(self, wi, wo, level):
        from scipy.stats import norm

        half = norm.ppf(0.5 + level / 2) * self.std(wi, wo)
        return GLOSS.eval(wi, wo) - half, GLOSS.eval(wi, wo) + half


def test_random_and_common_parts_add_in_squares():
    budget = Budget(Known(), common())
    wi, wo = pairs()
    f, u = GLOSS.eval(wi, wo), common().u(wi, wo)
    np.testing.assert_allclose(budget.std(wi, wo), f * np.hypot(0.01, u))
    low, high = budget.interval(wi, wo, 0.95)
    np.testing.assert_allclose(high - low, 2 * 1.959964 * f * np.hypot(0.01, u), rtol=1e-5)
    parts = budget.by_stratum(wi, wo)
    assert parts["combined"]["all"] >= max(parts["certificate"]["all"], parts["reconstruction"]["all"])


def test_a_reflectance_keeps_correlations():
    """The certificate counts in full; the random part is what the draws say."""
    budget = Budget(Known(), common(), lambda theta_i: np.full(3, 0.002))
    found = budget.reflectance(np.radians(30))
    wi = np.broadcast_to(from_angles(np.radians(30.0), 0.0), (200_000, 3))
    wo, pdf = GLOSS.sample(wi, np.random.default_rng(0).random((200_000, 2)))
    right = (GLOSS.eval(wi, wo) * (np.maximum(wo[:, 2], 0) / np.maximum(pdf, 1e-9))[:, None]).mean(0)
    np.testing.assert_allclose(found.value, right, rtol=5e-3)
    np.testing.assert_allclose(found.random / found.value, 0.002)
    assert (found.u / found.value > np.hypot(0.004, 0.002)).all() and (found.u / found.value < 0.012).all()


def test_strata():
    theta = np.radians([30.0, 30, 30, 80])
    wi = from_angles(theta, 0.0)
    wo = from_angles(np.radians([30.0, 40, 65, 10]), [np.pi, np.pi, 0.5, 0.0])
    assert [STRATA[k] for k in strata(GLOSS, wi, wo)] == ["peak", "flank", "floor", "grazing"]


def test_the_parts_of_a_reading_are_its_sigma(tmp_path):
    """Of a run: squares add up to what was stored, and each row has its own record, whatever the order of visits."""
    from gonio.budget import budget_of, write_budget
    from gonio.budget.of_run import raw_by_id
    from gonio.budget.readings import random_parts
    from gonio.config import Material
    from gonio.run.products import make_brdf
    from gonio.run.record.store import Store
    from gonio.run.start import start

    material = Material.model_validate(
        {"name": "x", "truth": "analytic_gloss", "channels": 3, "budget": {"measurements": 60}}
    )
    run = start(material, SIM, tmp_path / "run")
    run()
    run.close()
    with Store.open(tmp_path / "run", write=False) as store:
        m, raw, made = store.measured(), raw_by_id(store), store.raw()
    assert raw != made  # made in another order than asked for
    gain = np.full(3, np.pi / SIM.exposure_s)
    parts = random_parts(raw, m.seen[:, :3], m.seen[:, 3:], m.f, m.sigma, gain, SIM)
    np.testing.assert_allclose(np.sqrt(sum(p**2 for p in parts.values())), m.sigma / m.f, rtol=1e-9)
    from gonio.rig.build import kinematics_of

    shown = kinematics_of(SIM).forward(np.array([r["pose_rad"] for r in raw]))
    np.testing.assert_allclose(np.concatenate(shown, 1), m.seen, atol=1e-12)
    make_brdf(tmp_path / "run")
    found = write_budget(tmp_path / "run", budget_of(tmp_path / "run"))
    assert set(found["of_each_reading"]) == {"repeatability", "dark", "quantisation"} and found["of_angles"] == {}
