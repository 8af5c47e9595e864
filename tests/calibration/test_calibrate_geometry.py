"""Offsets and tilts of a simulated rig are found from what it sees."""

import csv

import numpy as np
import pytest
from typer.testing import CliRunner

from calibration.geometry import Observation, calibrate_geometry, read_observations
from gonio.brdf.models.lambert import Lambert
from gonio.cli import app
from gonio.config import load_config
from gonio.config.rig import CalibrationFiles, RigConfig
from gonio.geometry import half_vector, unit
from gonio.rig.build import gantry_chain, kinematics_of
from gonio.rig.errors import CalibrationMissing
from gonio.rig.kinematics.encoders import Encoders
from gonio.run.open_rig import open_rig
from tests.conftest import ROOT

SIM = load_config(ROOT / "configs/rigs/sim.yaml", RigConfig)
OFFSET = np.radians([1.2, -2.0, 0.7, 1.5])
AXES = {"light": (0.006, 1, -0.008), "azimuth": (0.007, -0.004, 1), "detector": (-0.005, 1, 0.006)}
AXES["turntable"] = (0, 0.004, 1)
TRUE = Encoders(gantry_chain(AXES), OFFSET)
NORMAL = unit(np.array([0.01, -0.006, 1.0]))
SIGMA = np.radians(0.02)


def poses(n, seed):
    most = np.radians([70, 170, 70, 170])
    return np.random.default_rng(seed).uniform(-most, most, (n, 4))


def noisy(w, rng):
    return unit(w + rng.normal(0, SIGMA, w.shape))


def observations(n_board, n_mirror, seed=0):
    rng = np.random.default_rng(seed)
    seen = []
    for kind, n in (("detector", n_board), ("light", n_board)):
        at = poses(n, rng.integers(1000))
        for pose, wi, wo in zip(at, *TRUE.forward(at)):
            seen.append(Observation(kind, pose, noisy(wo if kind == "detector" else wi, rng)))
    from scipy.optimize import least_squares

    def miss(q, light, table):
        wi, wo = TRUE.forward(np.array([[light, table, *q]]))
        return half_vector(wi, wo)[0, :2] - NORMAL[:2]

    for start in poses(4 * n_mirror, 77):
        found = least_squares(miss, [-start[0], 0.02], x_scale=[1, 10], args=start[:2])  # where the mirror's peak is
        if found.cost < 1e-20 and abs(found.x[0]) > 0.2 and len(seen) < 2 * n_board + n_mirror:
            seen.append(Observation("mirror", np.array([start[0], start[1], *(found.x + rng.normal(0, SIGMA, 2))])))
    return seen


def error_of(rig):
    at = poses(500, 5)
    return np.degrees(max(np.linalg.norm(a - b, axis=1).max() for a, b in zip(TRUE.forward(at), rig.forward(at))))


def test_a_bent_rig_is_found():
    found = calibrate_geometry(observations(25, 15), SIM, SIGMA, simulated=True)
    assert error_of(kinematics_of(SIM)) > 2  # before
    assert error_of(kinematics_of(SIM, found)) < 0.05
    assert 0.01 < found.residual_deg < 0.03
    for name, offset in zip(SIM.axis_names, np.degrees(OFFSET)):
        assert abs(found.offsets_deg[name] - offset) < max(5 * found.offsets_sigma_deg[name], 0.02) + 0.6, name


def test_a_calibrated_rig_drives_to_what_is_asked():
    rig = kinematics_of(SIM, calibrate_geometry(observations(25, 15), SIM, SIGMA))
    wi, wo = TRUE.forward(poses(50, 9))
    up = (wi[:, 2] > 0.2) & (wo[:, 2] > 0.2)
    at = rig.inverse(wi[up], wo[up], np.zeros(4))[:, 0]
    for a, b in zip(TRUE.forward(at), (wi[up], wo[up])):
        assert np.degrees(np.abs(a - b).max()) < 0.06


def test_wrong_data_is_refused():
    seen = observations(25, 0)
    rng = np.random.default_rng(0)
    mixed = [Observation(o.kind, rng.permutation(o.pose), o.direction) for o in seen]
    with pytest.raises(CalibrationMissing, match="disagree"):
        calibrate_geometry(mixed, SIM, SIGMA)
    with pytest.raises(CalibrationMissing, match="too few"):
        calibrate_geometry(seen[:3], SIM, SIGMA)


def test_a_table_of_observations(tmp_path):
    path = tmp_path / "seen.csv"
    head = "kind,light_deg,turntable_deg,detector_deg,azimuth_deg,x,y,z\n"
    path.write_text(head + "mirror,30,0,-30,0,,,\ndetector,10,20,30,40,0,0,2\n")
    mirror, detector = read_observations(path, SIM)
    assert mirror.kind == "mirror" and mirror.direction is None
    np.testing.assert_allclose(np.degrees(detector.pose), [10, 20, 30, 40])
    assert detector.direction.tolist() == [0, 0, 1]
    for line, message in (
        ("mirror,30,0,x,0,,,", r"seen\.csv:2: detector_deg is 'x'"),
        ("mirrors,30,0,1,0,,,", r"seen\.csv:2: kind is 'mirrors'"),
        ("light,30,0,1,0,nan,0,1", r"seen\.csv:2: x is 'nan'"),
    ):
        path.write_text(head + line + "\n")
        with pytest.raises(CalibrationMissing, match=message):
            read_observations(path, SIM)
    path.write_text("kind,light\n")
    with pytest.raises(CalibrationMissing, match="no column light_deg"):
        read_observations(path, SIM)
    with pytest.raises(CalibrationMissing, match="cannot be read"):
        read_observations(tmp_path / "none.csv", SIM)


def test_from_a_table_to_a_rig_by_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with open("seen.csv", "w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["kind", *(f"{n}_deg" for n in SIM.axis_names), "x", "y", "z"])
        for o in observations(25, 0):
            rows.writerow([o.kind, *np.degrees(o.pose), *o.direction])
    done = CliRunner().invoke(app, ["calibrate", "geometry", "seen.csv", "--rig", "sim"], catch_exceptions=False)
    assert done.exit_code == 0 and "observations agree to 0.0" in done.output
    file = next((tmp_path / "calibrations").glob("geometry-*.yaml"))
    assert f"calibrations/{file.name}: name it in the rig's YAML as calibration.geometry" in done.output
    rig = open_rig(SIM.model_copy(update={"calibration": CalibrationFiles(geometry=str(file))}), Lambert([0.3]), 0)
    assert rig.calibration_ids == {"geometry": file.stem} and error_of(rig.envelope.kinematics) < 0.05
