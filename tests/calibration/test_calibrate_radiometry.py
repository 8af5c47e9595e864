"""Gain, dark level and non-linearity of a simulated detector are found, and a rig measures right by them."""

import datetime as dt

import numpy as np
import pytest
from typer.testing import CliRunner

from calibration.radiometry import calibrate_radiometry, measure_reference, take_readings
from gonio.cli import app
from gonio.config import load_config
from gonio.config.rig import CalibrationFiles, RigConfig
from gonio.geometry import from_angles
from gonio.rig.build import nominal_radiometry
from gonio.rig.calibration import RadiometryCalibration, load_calibration, save_calibration
from gonio.rig.errors import CalibrationMissing
from gonio.run.open_rig import open_rig
from tests.conftest import ROOT

SIM = load_config(ROOT / "configs/rigs/sim.yaml", RigConfig)
BENT = SIM.model_copy(update={"photodiode": SIM.photodiode.model_copy(update={"nonlinearity": 0.03})})


class White:
    channels = 3
    f = np.array([0.31, 0.30, 0.29])

    def eval(self, wi, wo):
        return np.broadcast_to(self.f, (len(wi), 3)) * ((wi[:, 2:] > 0) & (wo[:, 2:] > 0))


def calibrate(config):
    rig = open_rig(config, White(), 11)
    found = measure_reference(rig, 0.0, 45.0, White.f)
    assert not rig.light.lit
    return found


def test_the_detector_is_found():
    found = calibrate(BENT)
    assert abs(found.linearity - 0.03) < 5 * found.linearity_sigma < 0.01
    z = (np.array(found.gain) - np.pi / SIM.exposure_s) / np.array(found.gain_sigma)
    assert np.abs(z).max() < 4.5 and max(found.gain_sigma) < 2e-3 * min(found.gain)
    np.testing.assert_allclose(np.array(found.dark) * SIM.exposure_s, 1e-3, rtol=0.1)


def test_a_rig_measures_by_its_calibration(tmp_path):
    path = save_calibration(calibrate(BENT), tmp_path)
    config = BENT.model_copy(update={"calibration": CalibrationFiles(radiometry=str(path))})
    rig = open_rig(config, White(), 12)
    wi, wo = from_angles(np.full(200, 0.3), 0.0), from_angles(np.full(200, 0.9), np.linspace(1, 3, 200))
    f = np.concatenate([v.f for v in rig.visit(wi, wo, np.arange(200))])
    np.testing.assert_allclose(f.mean(0), White.f, rtol=3e-3)
    assert rig.calibration_ids == {"radiometry": path.stem}


def test_missing_stale_and_foreign_files(tmp_path):
    found = calibrate(SIM)
    config = lambda p, **k: SIM.model_copy(update={"calibration": CalibrationFiles(radiometry=str(p), **k)})
    with pytest.raises(CalibrationMissing, match="no such calibration"):
        open_rig(config(tmp_path / "none.yaml"), White(), 0)
    old = save_calibration(found.model_copy(update={"date": dt.datetime(2020, 1, 1, tzinfo=dt.UTC)}), tmp_path)
    with pytest.raises(CalibrationMissing, match="days old"):
        open_rig(config(old, max_age_days=30.0), White(), 0)
    two = save_calibration(
        found.model_copy(update={"gain": (1.0, 1.0), "gain_sigma": (0.0, 0.0), "id": "two"}), tmp_path
    )
    with pytest.raises(CalibrationMissing, match="2 channels, the run has 3"):
        open_rig(config(two), White(), 0)
    camera = config(save_calibration(found, tmp_path)).model_copy(update={"detector": "camera"})
    with pytest.raises(CalibrationMissing, match="made with a photodiode, the rig has a camera"):
        open_rig(camera, White(), 0)
    old.write_text("id: x\n")
    with pytest.raises(CalibrationMissing, match="missing"):
        load_calibration(old, RadiometryCalibration)


def test_a_geometry_out_of_reach_is_refused():
    with pytest.raises(CalibrationMissing, match="0/4 degrees is out of rig sim's reach"):
        measure_reference(open_rig(SIM, White(), 11), 0.0, 4.0, White.f)


def test_useless_readings_are_refused():
    rig = open_rig(SIM, White(), 11)
    dark, _ = take_readings(rig.detector, rig.light, SIM.exposure_s)
    with pytest.raises(CalibrationMissing, match="light on"):
        calibrate_radiometry(dark, dark, White.f, 1.0, "sim")
    with pytest.raises(CalibrationMissing, match="cosine"):
        calibrate_radiometry(dark, dark, White.f, 0.01, "sim")
    with pytest.raises(CalibrationMissing, match="four dark"):
        calibrate_radiometry(dark[:2], dark, White.f, 1.0, "sim")


@pytest.mark.parametrize("depth", ["sim", "wire", "camera"])
def test_by_the_command_line(tmp_path, monkeypatch, depth):
    """At every depth, with either detector: the file that it writes makes the rig read what the certificate says."""
    monkeypatch.chdir(tmp_path)
    certificate = [arg for f in White.f for arg in ("--f", str(f))]
    done = CliRunner().invoke(app, ["calibrate", "radiometry", *certificate, "--rig", depth], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    file = next((tmp_path / "calibrations").glob("radiometry-*.yaml"))
    assert f"calibrations/{file.name}: name it in the rig's YAML as calibration.radiometry" in done.output
    found = load_calibration(file, RadiometryCalibration)
    config = load_config(ROOT / f"configs/rigs/{depth}.yaml", RigConfig)
    np.testing.assert_allclose(found.gain, nominal_radiometry(config, 3).gain, rtol=5e-3)
    assert found.certificate_u == 0.005 and min(np.array(found.gain_sigma) / found.gain) >= 0.005
    config = config.model_copy(update={"calibration": CalibrationFiles(radiometry=str(file))})
    rig = open_rig(config, White(), 12)
    wi, wo = from_angles(np.full(20, 0.3), 0.0), from_angles(np.full(20, 0.9), np.linspace(1, 3, 20))
    f = np.concatenate([v.f for v in rig.visit(wi, wo, np.arange(20))])
    rig.close()
    np.testing.assert_allclose(f.mean(0), White.f, rtol=5e-3)
