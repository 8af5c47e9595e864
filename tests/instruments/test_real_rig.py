"""A rig of depth `real` on emulated ports: steppers, a picoammeter and a lamp, by the commands of an operator."""

import datetime as dt
import json

import numpy as np
import pytest

from gonio.brdf.models.lambert import Lambert
from gonio.config import load_config
from gonio.config.rig import RigConfig
from gonio.rig.calibration import RadiometryCalibration, save_calibration
from sim.sample import Sample
from sim.wire.rig import Emulators
from tests.conftest import ROOT
from tests.instruments.test_rig import CONFIG, gonio

STEPPER = load_config(ROOT / "configs/rigs/stepper.yaml", RigConfig)
NAME = "steppers-and-keithley"


@pytest.fixture
def lab(tmp_path):
    fast = {"velocity_deg_s": 3600.0, "acceleration_deg_s2": 36000.0}
    config = STEPPER.model_copy(
        update={
            "name": NAME,
            "clock_scale": 1.0,
            "axes": {k: a.model_copy(update=fast) for k, a in STEPPER.axes.items()},
            "settle_s": 0.0,
            "exposure_s": 0.002,
            "detector": CONFIG.detector,
            "photodiode": CONFIG.photodiode,
        }
    )
    emulators = Emulators(config, Sample(Lambert([0.3])), 1)
    emulators.arms.device.deaf_to = 0
    now = dt.datetime.now(dt.UTC)
    made = RadiometryCalibration(
        id="radiometry-lab", date=now, rig=NAME, detector="text", gain=(np.pi / 0.002,), gain_sigma=(0.0,)
    )
    real = json.loads(emulators.config.model_dump_json(exclude={"clock_scale", "faults", "world"}))
    real |= {
        "depth": "real",
        "devices": json.loads(emulators.devices.model_dump_json(exclude_none=True, exclude={"photodiode"})),
        "calibration": {"radiometry": str(save_calibration(made, tmp_path))},
    }
    emulators.yaml = tmp_path / "lab.yaml"
    emulators.yaml.write_text(json.dumps(real))
    emulators.material = tmp_path / "felt.yaml"
    chains = {"proposal": "pss_simple", "chains": 4}
    emulators.material.write_text(json.dumps({"name": "felt", "channels": ["Y"], "sampler": chains}))
    yield emulators
    emulators.close()


def test_an_operators_first_hour(lab, tmp_path, monkeypatch):
    """check, doctor, home, measure, acquire, resume: homed once a start, measured right, the light off at the end."""
    monkeypatch.setattr("sim.wire.grbl.HOMING_S", 0.1)
    monkeypatch.chdir(tmp_path)
    said = gonio("check", lab.material, "--rig", lab.yaml)
    assert said.returncode == 0 and "keithley_6485 (text)" in said.stdout, said.stderr
    assert not lab.arms.device.lines  # nothing is touched
    said = gonio("doctor", "--rig", lab.yaml)
    assert "warn stage: is locked after an alarm" in said.stdout and "$H" not in lab.arms.device.lines
    said = gonio("home", "--rig", lab.yaml)
    assert said.returncode == 0 and "light -85" in said.stdout, said.stdout + said.stderr
    said = gonio("measure", "30", "10", "--rig", lab.yaml, "--json")
    f = json.loads(said.stdout)["f"][0]
    assert f == pytest.approx(0.3 / np.pi, rel=0.05)
    sets = ["--no-post", "--no-daemon", "--set"]
    done = gonio("acquire", lab.material, "--rig", lab.yaml, "--out", "run", *sets, "budget.measurements=12")
    assert done.returncode == 0, done.stderr
    done = gonio("resume", "run", "--no-post", "--set", "budget.measurements=16")
    assert done.returncode == 0, done.stderr
    from gonio.run.record.store import Store

    with Store.open(tmp_path / "run", write=False) as store:
        m, raw = store.measured(), store.raw()
    good = np.isfinite(m.f[:, 0])
    assert len(m.f) == 16 and good.sum() >= 12
    np.testing.assert_allclose(m.f[good, 0], 0.3 / np.pi, rtol=0.2)
    assert all("reply" in r for r in raw if r)
    assert lab.arms.device.lines.count("$H") == 4 and not lab.light.lamp.lit
    lab.arms.device.lost_switch = True
    said = gonio("measure", "30", "10", "--rig", lab.yaml)
    assert said.returncode == 3 and "homing does not find a limit switch" in said.stderr
    assert said.stderr.count("\n") == 1
