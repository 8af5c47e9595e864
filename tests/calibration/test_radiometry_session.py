"""A detector that is wrong in everything calibrates itself: curve, ranges, drift, gain, stray; bad references are
named."""

import numpy as np
import pytest
from typer.testing import CliRunner

from calibration.radiometry import Certificate, Session, read_certificate
from calibration.radiometry.curve import photon_transfer
from calibration.radiometry.stability import stability
from gonio.bench.accuracy.calibrated_rig import _linear
from gonio.brdf.models.lambert import Lambert
from gonio.cli import app
from gonio.config import load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.geometry import from_angles
from gonio.rig.build import radiometry_of
from gonio.rig.calibration import save_calibration
from gonio.rig.errors import CalibrationMissing
from gonio.run.open_rig import open_rig
from sim.standard import Standard
from sim.world import TrueRig

F = np.array([0.31, 0.30, 0.29])
BASE = load_config(find_config("uncalibrated", "rigs"), RigConfig)
STRAIGHT = {"offsets_deg": {}, "tilts_deg": {}, "eccentricity_deg": {}, "axes_miss_mm": {}, "sample_tilt_deg": (0, 0)}


def wrong(seed=1, **world):
    straight = {**STRAIGHT, "backlash_deg": {}, "sample_height_mm": 0.0}
    return RigConfig.model_validate({**BASE.model_dump(), "world": {"seed": seed, **straight, **world}})


def calibrated(config, certificate=None, lies=None, trap=None, minutes=5.0):
    session = Session(certificate or Certificate.of_one(45, 0, F, 0.0), stability_s=60 * minutes)
    rig = open_rig(config, lies or Lambert(np.pi * F), 0)
    session.measure_white(rig)
    assert not rig.light.lit
    dark = open_rig(config, trap or Lambert([0.0] * 3), 0)
    session.measure_trap(dark)
    return session, session.result(rig)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_all_that_is_hidden_is_found(seed):
    config = wrong(seed, polarisation=0.0)
    _, found = calibrated(config)
    true = TrueRig(config, 3)
    h, per = true.hidden, config.exposure_s
    z = np.concatenate(
        [
            (np.array(found.gain) - np.pi / per * h.gain * true.through) / found.gain_sigma,
            [(found.linearity - h.nonlinearity) / found.linearity_sigma],
            (np.array(found.range_ratios) - h.ratios)[1:] / np.array(found.range_ratios_sigma)[1:],
            (np.array(found.stray) - h.gain * h.stray / per) / found.stray_sigma,
            [(found.drift_per_h - 3600 * h.drift) / found.drift_per_h_sigma],
        ]
    )
    assert np.abs(z).max() < 4
    assert max(found.gain_sigma) < 2e-3 * min(found.gain) and found.linearity_sigma < 1e-3
    assert found.shot_noise == pytest.approx(0.005, rel=0.1) and found.read_noise == pytest.approx(1e-4, rel=0.1)
    assert _linear(config, true, found) < 0.005
    before = found.model_copy(update={"linearity": 0.0, "range_ratios": (1.0, 1.0, 1.0)})
    assert _linear(config, true, before) > 0.005  # negative control


def test_a_rig_reads_right_by_it(tmp_path):
    config = wrong(4)
    _, found = calibrated(config)
    files = config.calibration.model_copy(update={"radiometry": str(save_calibration(found, tmp_path))})
    for c, limit in ((config.model_copy(update={"calibration": files}), 0.005), (config, None)):
        rig = open_rig(c, Lambert(np.pi * F), 3)
        wi, wo = from_angles(np.radians(np.full(200, 20.0)), 0.0), from_angles(np.radians(np.full(200, 50.0)), 2.0)
        f = np.concatenate([v.f for v in rig.visit(wi, wo, np.arange(200))]).mean(0)
        off = np.abs(f / F - 1).max()
        assert off < limit if limit else off > 0.01
    assert radiometry_of(c, 3).ratios is None


def test_the_lamp_is_watched():
    t = np.linspace(0, 300, 120)
    rng = np.random.default_rng(0)
    noise = rng.normal(0, 4e-4, 120)
    steady = stability(t, 5.0 * (1 + 0.02 * t / 3600 + noise))
    assert abs(steady.drift * 3600 - 0.02) < 4 * steady.drift_sigma * 3600 < 0.02 and steady.warm_s == 0
    warming = stability(t, 5.0 * (1 - 0.2 * np.exp(-t / 20) + noise))
    assert 40 < warming.warm_s < 200 and abs(warming.drift) < 6 * warming.drift_sigma
    nothing = stability(t[:3], np.ones(3))
    assert nothing.drift == 0 and nothing.drift_sigma > 1e-6


def test_photon_transfer_is_what_was_put_in():
    from calibration.radiometry.curve import Point

    rng = np.random.default_rng(0)
    points = []
    for light in np.geomspace(1e-4, 10, 30):
        values = light + rng.normal(0, np.sqrt(1e-8 + 2.5e-5 * light), (200, 3))
        points.append(
            Point(0, 1.0, 0.0, (0, 0, 0), np.full(3, 8.0), values.mean(0), values.std(0), values.std(0, ddof=1), 200)
        )
    shot, read = photon_transfer(points, np.zeros((2, 3)), 1.0)
    assert shot == pytest.approx(0.005, rel=0.03) and read == pytest.approx(1e-4, rel=0.1)


def table(n=9, bump=0.2):
    theta = np.linspace(0, 70, n)
    f = 0.31 * (1 + bump * (theta / 70) ** 4)
    return theta, f


def write_table(path, theta, f, extra=""):
    rows = "".join(f"{t:.6g},{0 if t > 10 else 45},180,{v:.6g}\n" for t, v in zip(theta, f))
    path.write_text("theta_i_deg,theta_o_deg,phi_deg,f\n" + rows + extra)


def test_a_reference_by_its_table(tmp_path):
    """A standard a fifth brighter at high angles: right by its table, and visibly wrong as one number."""
    theta, f = table()
    write_table(tmp_path / "c.csv", theta, f)
    certificate = read_certificate(tmp_path / "c.csv", 0.002)
    assert len(certificate.f) == 9 and np.isin(certificate.unused, certificate.used).sum() == 0
    config = wrong(5, polarisation=0.0)
    lies = Standard(certificate.wi, certificate.wo, certificate.f, 3)
    session, found = calibrated(config, certificate, lies)
    true = TrueRig(config, 3)
    np.testing.assert_allclose(found.gain, np.pi / config.exposure_s * true.hidden.gain * true.through, rtol=5e-3)
    assert len(session.angles) == 5
    flat = Certificate(certificate.wi, certificate.wo, np.full_like(certificate.f, 0.31), certificate.u)
    with pytest.raises(CalibrationMissing, match=r"the gain differs by .* from angle to angle"):
        calibrated(config, flat, lies)


@pytest.mark.parametrize(
    ("extra", "what"),
    [
        ("30,0,180,\n", r"c\.csv:5: f is ''; fill the hole"),
        ("30,0,180,31\n", r"c\.csv:5: f must lie between 0 and 1.5"),
        ("30,0,180,0.98\n", r"c\.csv:5: f of 0.98 1/sr reflects more than falls on it"),
        ("95,0,180,0.3\n", r"c\.csv:5: an angle from the normal"),
        ("x,0,180,0.3\n", r"c\.csv:5: theta_i_deg is 'x'"),
    ],
)
def test_a_table_with_a_hole(tmp_path, extra, what):
    write_table(tmp_path / "c.csv", *table(3), extra)
    with pytest.raises(CalibrationMissing, match=what):
        read_certificate(tmp_path / "c.csv", 0.002)
    (tmp_path / "c.csv").write_text("theta_i_deg,theta_o_deg,f\n")
    with pytest.raises(CalibrationMissing, match="no column phi_deg"):
        read_certificate(tmp_path / "c.csv", 0.002)


def test_a_rig_that_looks_past_the_normal_takes_the_angle_beside():
    """Axes out of square leave a hole about the normal; 45/0 is shown as 45/0.7."""
    from calibration.radiometry.certificate import within_reach

    hole = lambda wi, wo: (wo[:, 2] < np.cos(np.radians(0.6))) & (wi[:, 2] < np.cos(np.radians(0.6)))
    moved, ok = within_reach(Certificate.of_one(45, 0, F, 0.0), hole)
    assert ok.all() and 0.5 < np.degrees(np.arccos(moved.wo[0, 2])) < 1.5
    assert not within_reach(Certificate.of_one(45, 0, F, 0.0), lambda wi, wo: wo[:, 2] < 0.9)[1].any()


def test_what_is_wrong_is_said():
    config = wrong(1)
    with pytest.raises(CalibrationMissing, match="is the lamp on"):
        calibrated(config, lies=Lambert([0.0] * 3), minutes=0.1)
    with pytest.raises(CalibrationMissing, match="certificate has 2 channels, the detector 3"):
        calibrated(config, Certificate.of_one(45, 0, F[:2], 0.0))
    with pytest.raises(CalibrationMissing, match="no angle of the certificate is in rig"):
        calibrated(config, Certificate.of_one(2, 0, F, 0.0))


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (["calibrate", "radiometry"], "give the reference's f"),
        (["calibrate", "radiometry", "--f", "31"], "--f 31: must lie between 0 and 0.5"),
        (["calibrate", "radiometry", "--f", "0.98"], "about 0.31, which is its reflectance over pi"),
        (["calibrate", "verify", "--f", "0.3", "--table", "x.csv"], "and not both"),
        (["calibrate", "all", "--table", "none.csv"], "none.csv: cannot be read"),
    ],
)
def test_bad_calls(call, what):
    assert what in str(CliRunner().invoke(app, call).exception)


def test_a_detector_that_saturates_is_said():
    """Every reading above its highest range: no curve is made of what is left."""
    config = wrong(1)
    small = config.model_copy(
        update={"photodiode": config.photodiode.model_copy(update={"full_scale": 1e-4, "ranges": 1})}
    )
    small = RigConfig.model_validate({**small.model_dump(), "world": {**STRAIGHT}})
    with pytest.raises(CalibrationMissing, match="saturates the detector; put a filter"):
        calibrated(small, minutes=0.1)


def test_readings_before_a_fault_are_kept(tmp_path, monkeypatch):
    import json

    from gonio.rig.errors import DeviceFault

    def pulled(self, *args):
        raise DeviceFault("photodiode", "no reply", "check its cable")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Session, "_gain", pulled)
    done = CliRunner().invoke(app, ["calibrate", "radiometry", "--rig", "sim", "--f", "0.31", "--stability", "0"])
    assert isinstance(done.exception, DeviceFault) and not list(tmp_path.glob("calibrations/*.yaml"))
    kept = json.loads((tmp_path / "calibrations/radiometry-unfinished.json").read_text())
    assert len(kept["points"]) > 20 and kept["angles"] == []


def test_stray_light_is_not_in_the_gain():
    """The trap is looked at after the reference; what it finds was on the reference too."""
    config = wrong(
        stray=0.02, gain=(1.0,), polarisation=0.0, drift_per_h=0.0, nonlinearity=0.0, range_ratios=(1.0, 1.0)
    )
    session, found = calibrated(config)
    true = TrueRig(config, 3)
    z = (np.array(found.gain) - np.pi / config.exposure_s * true.through) / found.gain_sigma
    assert np.abs(z).max() < 4
    session.stray = np.zeros(0)  # negative control
    with_it = np.array(session.result(open_rig(config, Lambert(np.pi * F), 0)).gain)
    assert (with_it / found.gain).min() > 1.02


def test_a_spike_is_no_reading():
    from calibration.radiometry.session import unspiked

    rng = np.random.default_rng(0)
    values = rng.normal(1.0, 0.005, (48, 3))
    values[7] *= 10
    good = unspiked(values, np.full_like(values, 0.005))
    assert not good[7] and good.sum() >= 46
    assert unspiked(np.ones((5, 2)), np.zeros((5, 2))).all()
