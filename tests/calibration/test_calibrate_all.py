"""A session as an operator has it: calibrate all, go on after Ctrl-C, measure, look at the budget."""

import csv
import json

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

import calibration.geometry.session as session_module
from gonio.cli import app
from gonio.config.find import find_config

REFERENCE = ["--f", "0.31", "--f", "0.30", "--f", "0.29"]


@pytest.fixture
def few(monkeypatch, tmp_path):
    monkeypatch.setattr(session_module, "FEWEST", 12)
    monkeypatch.setattr(session_module, "MOST", 18)
    monkeypatch.setattr(session_module, "HELD_OUT", 3)
    monkeypatch.chdir(tmp_path)


def gonio(*args):
    return CliRunner().invoke(app, [str(a) for a in args], catch_exceptions=False)


@pytest.mark.slow
def test_a_session_on_devices(tmp_path, few, monkeypatch):
    call = ["calibrate", "all", "--rig", "uncalibrated", *REFERENCE, "--stability", "1"]

    def interrupted(*args, **kw):
        raise KeyboardInterrupt

    with monkeypatch.context() as m:
        m.setattr("gonio.commands.calibrate.calibrating.radiometry_by_reference", interrupted)
        assert CliRunner().invoke(app, call).exit_code != 0
    made = sorted(p.name for p in (tmp_path / "calibrations").iterdir())
    assert [p.split("-")[0] for p in made if p.endswith(".yaml")] == ["geometry", "uncalibrated.yaml"]
    done = gonio(*call, "--after", "60")
    assert done.exit_code == 0 and "geometry  done:" in done.output and "checks made hold" in done.output
    rig = tmp_path / "calibrations/uncalibrated.yaml"
    names = yaml.safe_load(rig.read_text())["calibration"]
    assert set(names) == {"geometry", "radiometry"}
    assert "radiometry  done:" in gonio(*call).output
    sets = ["--set", "budget.measurements=150"]
    assert gonio("acquire", "analytic_gloss", "--rig", rig, *sets, "--out", "run").exit_code == 0
    found = json.loads(gonio("budget", "run", "--theta-i", "45", "--json").output)
    parts = set(found["relative"])
    assert {"reconstruction", "certificate", "gain", "linearity", "ranges", "stray", "drift", "angles"} < parts
    assert (
        found["relative"]["certificate"]["all"] == pytest.approx(0.005)
        and len(found["left_out"]) == 1
        and "polarisation" in found["left_out"][0]
    )
    (row,) = found["dhr"]
    assert row["theta_i_deg"] == 45 and all(0.004 < u / v < 0.1 for u, v in zip(row["u"], row["value"]))
    assert "Uncertainty budget" in (tmp_path / "run/report.html").read_text()
    gonio("export", "run", "--format", "csv")
    table = list(csv.DictReader((tmp_path / "run/samples.csv").open()))
    assert 0.004 < float(table[-1]["u_shared_0"]) < 1
    raw = yaml.safe_load(rig.read_text())
    raw["axes"]["light"]["upper_deg"] = 80
    head = rig.read_text().splitlines()[0]
    rig.write_text(f"{head}\n{yaml.safe_dump(raw)}")
    assert "another rig, or this one was changed" in str(CliRunner().invoke(app, call).exception)


@pytest.mark.slow
def test_a_shorter_one_through_the_real_drivers(tmp_path, few, monkeypatch):
    text = yaml.safe_load(find_config("wire", "rigs").read_text())
    offsets = {"light": 1.0, "turntable": 0.0, "detector": -0.8, "azimuth": 0.6}
    text |= {
        "name": "bent",
        "clock_scale": 400.0,
        "world": {"offsets_deg": offsets, "gain": [1.07], "range_ratios": [1.01, 0.99]},
    }
    (tmp_path / "bent.yaml").write_text(yaml.safe_dump(text))
    done = gonio("calibrate", "all", "--rig", "bent.yaml", *REFERENCE, "--stability", "0.2")
    assert done.exit_code == 0, done.output
    found = yaml.safe_load(next((tmp_path / "calibrations").glob("radiometry-*.yaml")).read_text())
    np.testing.assert_allclose(np.array(found["gain"]) * 0.02 / np.pi, 1.07, rtol=0.01)
    np.testing.assert_allclose(found["range_ratios"][1], 1.01, atol=2e-3)
    sets = ["--set", "budget.measurements=30", "--set", "rig.clock_scale=400"]
    rig = tmp_path / "calibrations/bent.yaml"
    assert gonio("acquire", "analytic_gloss", "--rig", rig, *sets, "--out", "run").exit_code == 0
    assert "certificate" in gonio("budget", "run").output


@pytest.mark.slow
def test_a_budget_of_what_was_never_calibrated_says_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert gonio("acquire", "analytic_gloss", "--set", "budget.measurements=30", "--out", "run").exit_code == 0
    done = gonio("budget", "run")
    assert "gonio calibrate radiometry" in done.output and "gonio calibrate geometry --mirror" in done.output
    assert "Uncertainty budget" not in (tmp_path / "run/report.html").read_text()
