"""Calibrations that are no longer to be believed: refused with the command that makes them anew, or recorded."""

import datetime as dt
import json
import sqlite3

import pytest
from typer.testing import CliRunner

from gonio.brdf.models.lambert import Lambert
from gonio.cli import app
from gonio.config import load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.rig.calibration import RadiometryCalibration, save_calibration
from gonio.rig.errors import CalibrationMissing
from gonio.rig.stale import made_for, stale
from gonio.run.open_rig import open_rig

SIM = load_config(find_config("sim", "rigs"), RigConfig)
NOW = dt.datetime.now(dt.UTC)


def saved(tmp_path, **said):
    plain = {"id": "radiometry-x", "date": NOW, "rig": "sim", "made_for": made_for("radiometry", SIM)}
    gain = {"gain": (157.0,) * 3, "gain_sigma": (0.1,) * 3}
    return save_calibration(RadiometryCalibration(**{**plain, **gain, **said}), tmp_path)


def rig_with(path, config=SIM, **limits):
    return config.model_copy(
        update={"calibration": config.calibration.model_copy(update={"radiometry": str(path), **limits})}
    )


@pytest.mark.parametrize(
    ("said", "limits", "what"),
    [
        ({"date": NOW - dt.timedelta(days=40)}, {"max_age_days": 30.0}, "40 days old, the rig allows 30"),
        ({"date": NOW + dt.timedelta(days=2)}, {}, "hours ahead of this machine's clock; set the clock"),
        ({"rig": "bench"}, {}, "made on rig bench, this is sim"),
        ({"made_for": "other"}, {}, "the rig's YAML was changed since"),
        ({"temperature_c": 20.0}, {"temperature_c": 27.0}, "made at 20 degrees C, the room is at 27"),
    ],
)
def test_refused_with_a_reason_or_allowed(tmp_path, said, limits, what):
    config = rig_with(saved(tmp_path, **said), **limits)
    with pytest.raises(CalibrationMissing, match=what) as e:
        open_rig(config, Lambert([0.3] * 3), 0)
    assert e.value.exit_code == 5 and "gonio calibrate radiometry" in str(e.value) and "--allow-stale" in str(e.value)
    allowed = rig_with(config.calibration.radiometry, allow_stale=True, **limits)
    open_rig(allowed, Lambert([0.3] * 3), 0).close()
    assert what in stale(allowed)["radiometry"]


def test_a_fresh_one_is_taken(tmp_path):
    path = saved(tmp_path, temperature_c=20.0)
    assert stale(rig_with(path, max_age_days=1.0, temperature_c=23.0)) == {}
    moved = SIM.model_copy(update={"park_deg": {"light": -30.0}, "settle_s": 0.3})  # nothing that radiometry hangs on
    assert stale(rig_with(path, moved)) == {}
    longer = SIM.model_copy(update={"exposure_s": 0.1})
    assert "radiometry" in stale(rig_with(path, longer))


def test_acquire_check_and_resume(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = saved(tmp_path, date=NOW - dt.timedelta(days=40))
    sets = [f"rig.calibration.radiometry={path}", "rig.calibration.max_age_days=30", "budget.measurements=30"]
    call = ["analytic_gloss", "--rig", "sim", *[a for s in sets for a in ("--set", s)]]
    for command in ("check", "acquire"):
        done = CliRunner().invoke(app, [command, *call])
        assert "40 days old" in str(done.exception), command
    assert not (tmp_path / "runs").exists()
    done = CliRunner().invoke(app, ["acquire", *call, "--allow-stale", "--out", "run"], catch_exceptions=False)
    assert done.exit_code == 0
    with sqlite3.connect(tmp_path / "run" / "run.sqlite") as db:
        text = db.execute("SELECT value FROM meta WHERE key = 'provenance'").fetchone()[0]
    assert "40 days old" in json.loads(text)["stale"]["radiometry"]
    assert "40 days old" in (tmp_path / "run" / "report.html").read_text()


def test_doctor_names_what_has_expired(tmp_path):
    from drivers.doctor import _calibration

    path = saved(tmp_path, date=NOW - dt.timedelta(days=40))
    lines = list(_calibration(rig_with(path, max_age_days=30.0)))
    assert [line for line in lines if line.startswith("FAIL")] == [
        f"FAIL radiometry: {path}: 40 days old, the rig allows 30"
    ]


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("offsets_deg: {lihgt: 5}", "offsets_deg.lihgt: no such axis"),
        ("axes: {light: [0, 0, 0]}", "must not be the zero vector"),
        ("eccentricity_deg: {light: [90, 0, 0, 0]}", "is no encoder"),
        ("parameters: {a: 1.0}\ncovariance: [[1.0, 0.0]]", "must be 1 x 1"),
    ],
)
def test_geometries_by_hand_that_cannot_be(tmp_path, text, what):
    (tmp_path / "g.yaml").write_text(f"id: g\ndate: 2026-01-01T00:00:00Z\nrig: sim\n{text}\n")
    files = SIM.calibration.model_copy(update={"geometry": str(tmp_path / "g.yaml")})
    with pytest.raises(CalibrationMissing, match=what):
        open_rig(SIM.model_copy(update={"calibration": files}), Lambert([0.3] * 3), 0)


@pytest.mark.parametrize(
    ("said", "what"),
    [
        ({"gain": (0.0, 1.0, 1.0)}, "above 0"),
        ({"gain_sigma": (0.1,)}, "1 numbers for 3 channels"),
        ({"stray": (0.1,)}, "stray: 1 numbers for 3"),
        ({"range_ratios": (1.0, 0.0, 1.0)}, "between 0.1 and 10"),
    ],
)
def test_radiometries_by_hand_that_cannot_be(tmp_path, said, what):
    import yaml

    path = saved(tmp_path)
    raw = yaml.safe_load(path.read_text()) | {k: list(v) for k, v in said.items()}
    path.write_text(yaml.safe_dump(raw))
    with pytest.raises(CalibrationMissing, match=what):
        open_rig(rig_with(path), Lambert([0.3] * 3), 0)


def test_what_is_missing_can_be_made_anew_and_a_folder_that_cannot_be_written_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    import yaml

    text = yaml.safe_load(find_config("sim", "rigs").read_text())
    text["calibration"] = {"radiometry": "gone.yaml"}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(text))
    call = ["calibrate", "radiometry", "--rig", "rig.yaml", "--f", "0.31", "--stability", "0"]
    assert CliRunner().invoke(app, call, catch_exceptions=False).exit_code == 0
    (tmp_path / "file").write_text("")
    done = CliRunner().invoke(app, [*call, "--out", "file"])
    assert "file: cannot be written" in str(done.exception) and done.exception.exit_code == 2


def test_calibrate_all_knows_its_own_file_and_its_reference(tmp_path):
    from gonio.commands.calibrate.calibrated import Calibrated
    from gonio.config import ConfigError

    (tmp_path / "sim.yaml").write_text("# mine\nname: sim\n")
    with pytest.raises(ConfigError, match="a rig file of your own"):
        Calibrated(SIM, tmp_path, "abc", again=True)
    (tmp_path / "sim.yaml").unlink()
    made = Calibrated(SIM, tmp_path, "abc", again=False)
    geometry = tmp_path / "g.yaml"
    geometry.write_text("id: g\ndate: 2026-01-01T00:00:00Z\nrig: sim\n")
    made.add("geometry", geometry)
    made.add("radiometry", saved(tmp_path, reference="abc"))
    assert set(Calibrated(SIM, tmp_path, "abc", again=False).done) == {"geometry", "radiometry"}
    with pytest.raises(CalibrationMissing, match="another reference; begin anew with --again"):
        Calibrated(SIM, tmp_path, "other", again=False)
    geometry.unlink()
    assert Calibrated(SIM, tmp_path, "abc", again=False).done == {}
