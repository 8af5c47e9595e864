"""A rig with hidden errors calibrates itself by a mirror; what goes wrong with it is named."""

import numpy as np
import pytest
from typer.testing import CliRunner

import calibration.geometry.session as session_module
from calibration.geometry import Observation, Parameters, fit_geometry, read_observations
from calibration.geometry.design import best, candidates
from calibration.geometry.fit import Fit, apart, random_poses
from calibration.geometry.looking import Looking
from calibration.geometry.session import Session
from calibration.geometry.slip import slipped
from gonio.cli import app
from gonio.config import load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.geometry import reflect
from gonio.rig.build import envelope_of, kinematics_of
from gonio.rig.calibration import GeometryCalibration, load_calibration
from gonio.rig.errors import CalibrationMissing
from gonio.run.open_rig import open_rig
from sim.mirror import Mirror
from sim.world import TrueRig

WRONG = load_config(find_config("uncalibrated", "rigs"), RigConfig)
WEDGE = np.array([np.sin(np.radians(15)), 0, np.cos(np.radians(15))])
POSES = random_poses(WRONG, 400, np.random.default_rng(5))


@pytest.fixture
def few(monkeypatch):
    """As many peaks as a test can wait for."""
    monkeypatch.setattr(session_module, "FEWEST", 12)
    monkeypatch.setattr(session_module, "MOST", 24)
    monkeypatch.setattr(session_module, "HELD_OUT", 3)


def truth(config):
    return kinematics_of(config, TrueRig(config, 3).geometry(config))


def rms_deg(a, b):
    return float(np.degrees(np.sqrt(np.mean(apart(a, b, POSES) ** 2))))


def peaks(n, kinematics, mirrors=((0.0, 0, 1.0),), seed=0):
    """Observations that a rig of these kinematics would make, exact."""
    rng, envelope, seen = np.random.default_rng(seed), envelope_of(WRONG), []
    while len(seen) < n:
        j = len(seen) % len(mirrors)
        normal = np.array(mirrors[j])
        theta, phi = np.radians(rng.uniform(8, 65)), rng.uniform(-np.pi, np.pi)
        wi = np.array([[np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]])
        wo = reflect(wi, normal[None])
        poses = kinematics.inverse(wi, wo, np.zeros(4))[0]
        poses = poses[np.isfinite(poses).all(1) & envelope.inside(poses)]
        if len(poses) and wo[0, 2] > 0.2:
            down = np.zeros(4, bool)
            seen.append(Observation("mirror", poses[rng.integers(len(poses))], None, 1e-5, down, j))
    return seen


def test_a_rig_that_is_wrong_in_everything_finds_itself(few):
    true = truth(WRONG)
    session = Session(WRONG, (WEDGE,))
    for number, mirror in enumerate((Mirror(), Mirror.on_wedge(15))):
        rig = open_rig(WRONG, mirror, 0)
        session.measure(rig, number)
        assert not rig.light.lit
        rig.close()
    session.confirm()
    assert rms_deg(true, kinematics_of(WRONG)) > 1
    assert rms_deg(true, session.fit.kinematics) < 0.05
    assert np.degrees(session.held_out_rms) < 0.02
    exact = session.parameters.inverse_of(TrueRig(WRONG, 3).geometry(WRONG))
    z = ((session.fit.p - exact) / session.fit.sigma)[:-2]  # the wedge lies as somebody laid it
    assert (np.abs(z) < 3).mean() > 0.95
    backlash = session.parameters.of(session.fit.p, "backlash") - TrueRig(WRONG, 3).backlash
    assert np.abs(np.degrees(backlash)).max() < 0.05
    assert session.only_turns("offset.turntable") and not session.only_turns("offset.detector")


def test_poses_are_chosen_where_they_tell_most():
    q = Parameters(WRONG, (WEDGE,))
    start = Fit(q, np.zeros(len(q)), np.diag(q.prior**2), np.zeros((0, 3)), 0.0, 1.0)
    at = candidates(start, envelope_of(WRONG), 0, 200, np.random.default_rng(0))
    goal = np.full(len(q), np.radians(0.03))

    def left(picks):
        c = start.covariance
        for j in at.jacobian[picks]:
            c = c - c @ j.T @ np.linalg.solve(j @ c @ j.T + 1e-8 * np.eye(3), j @ c)
        return np.linalg.slogdet(c)[1]

    chosen = best(start, at, 1e-4, goal, 12)
    assert len(set(chosen)) == 12
    at_random = [left(np.random.default_rng(k).choice(len(at.poses), 12, replace=False)) for k in range(20)]
    assert left(chosen) < min(at_random)
    assert at.down[chosen].any(0).sum() >= 3  # backlash is among what is open


@pytest.mark.slow
def test_an_axis_that_slipped_is_named():
    kinematics = truth(WRONG)
    seen = peaks(60, kinematics)
    fit = fit_geometry(seen, Parameters(WRONG))
    assert fit.excess < 1.5 and np.degrees(fit.rms) < 0.002
    for o in seen[35:]:
        o.pose[2] += np.radians(0.6)
    fit = fit_geometry(seen, Parameters(WRONG))
    assert fit.excess > 10
    text = slipped(seen, fit)
    assert text.startswith("detector seems to have slipped by +0.6 degrees near peak 36")
    rng = np.random.default_rng(1)
    for o in seen:
        o.pose[:] += rng.normal(0, np.radians(0.5), 4)
    assert "is everything tight" in slipped(seen, fit_geometry(seen, Parameters(WRONG)))


def test_the_sample_lies_as_the_mirror_did_unless_boards_say_where_it_lies():
    found = fit_geometry(peaks(80, truth(WRONG)), Parameters(WRONG))
    lie = np.degrees(found.parameters.of(found.p, "lie"))
    assert np.abs(lie).max() > 0.1


@pytest.mark.parametrize(
    ("lies", "what"),
    [
        (Mirror([[0, 0, 1], [0.02, 0.01, 1]]), "two peaks"),
        pytest.param(Mirror([[0.13, 0, 1]]), "from level|no peak within", marks=pytest.mark.slow),
        (Mirror(reflectance=0.0), "is the lamp on"),
    ],
    ids=["cracked", "tilted", "dark"],
)
def test_what_is_wrong_is_one_line(tmp_path, monkeypatch, few, lies, what):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("gonio.commands.calibrate.laid_down.mirror", lambda config, wedge: lies)
    done = CliRunner().invoke(app, ["calibrate", "geometry", "--mirror", "--rig", "uncalibrated"])
    assert done.exit_code == 1 and isinstance(done.exception, CalibrationMissing)
    assert done.exception.exit_code == 5 and "\n" not in str(done.exception)
    import re

    assert re.search(what, str(done.exception))
    assert not list(tmp_path.glob("calibrations/*.yaml"))


@pytest.mark.slow
def test_a_slip_half_way_is_not_saved_but_by_force(tmp_path, monkeypatch, few):
    """The zero slips between the two mirrors; peaks are kept, and --force saves what there is."""
    monkeypatch.chdir(tmp_path)
    opened = []

    def slipping(config, *args, **kw):
        opened.append(1)
        if len(opened) == 2:
            drawn = dict(zip(config.axis_names, np.degrees(TrueRig(config, 3).hidden.offsets).tolist()))
            world = {"seed": 1, "offsets_deg": {**drawn, "light": drawn["light"] + 0.8}}
            config = RigConfig.model_validate({**config.model_dump(), "world": world})
        return open_rig(config, *args, **kw)

    monkeypatch.setattr("gonio.daemon.rig_owner.open_rig", slipping)
    call = ["calibrate", "geometry", "--mirror", "--rig", "uncalibrated"]
    done = CliRunner().invoke(app, call)
    assert isinstance(done.exception, CalibrationMissing) and "peaks kept in" in str(done.exception)
    assert "no rig explains" in str(done.exception)
    assert len(read_observations(tmp_path / "calibrations/geometry-unfinished.csv", WRONG)) > 20
    assert not list(tmp_path.glob("calibrations/*.yaml"))
    opened.clear()
    done = CliRunner().invoke(app, [*call, "--force"], catch_exceptions=False)
    assert done.exit_code == 0 and len(list(tmp_path.glob("calibrations/geometry-*.yaml"))) == 1


def test_peaks_can_be_fitted_again_from_their_table(tmp_path):
    from calibration.geometry import calibrate_geometry, write_observations

    seen = peaks(60, truth(WRONG))
    write_observations(tmp_path / "peaks.csv", seen, WRONG)
    again = read_observations(tmp_path / "peaks.csv", WRONG)
    assert [o.mirror for o in again] == [o.mirror for o in seen] and again[0].sigma == pytest.approx(1e-5, rel=0.1)
    found = calibrate_geometry(again, WRONG)
    assert rms_deg(truth(WRONG), kinematics_of(WRONG, found)) < 0.1


@pytest.mark.parametrize(
    ("call", "what"),
    [
        (["calibrate", "geometry", "--rig", "uncalibrated"], "give a CSV of what was seen, or --mirror"),
        (["calibrate", "geometry", "--mirror", "--rig", "ideal"], "is ideal"),
    ],
)
def test_bad_calls(call, what):
    done = CliRunner().invoke(app, call)
    assert what in str(done.exception)


@pytest.mark.slow
def test_by_the_command_line(tmp_path, monkeypatch, few):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(
        app, ["calibrate", "geometry", "--mirror", "--rig", "uncalibrated"], catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    file = next(tmp_path.glob("calibrations/geometry-*.yaml"))
    assert f"calibrations/{file.name}: name it in the rig's YAML as calibration.geometry" in done.output
    assert file.with_suffix(".png").exists() and file.with_suffix(".csv").exists()
    found = load_calibration(file, GeometryCalibration)
    assert rms_deg(truth(WRONG), kinematics_of(WRONG, found)) < 0.05
    assert len(found.covariance) == len(found.parameters)


def test_a_flat_mirror_alone_says_what_it_does_not_tell(tmp_path, monkeypatch, few):
    """Arms that err against each other look right to it while the detector's azimuth is 0."""
    monkeypatch.chdir(tmp_path)
    call = ["calibrate", "geometry", "--mirror", "--rig", "sim", "--wedge", "0"]
    done = CliRunner().invoke(app, call, catch_exceptions=False)
    assert "warning  that is little" in done.output and "--wedge 15" in done.output
    assert done.output.count("the zero of turntable") == 1


def test_a_mirror_too_bright_at_the_faintest_is_said(tmp_path, monkeypatch, few):
    monkeypatch.chdir(tmp_path)
    call = ["calibrate", "geometry", "--mirror", "--rig"]
    import yaml

    text = yaml.safe_load(find_config("uncalibrated", "rigs").read_text())
    text["photodiode"] |= {"full_scale": 0.05, "ranges": 1}
    (tmp_path / "bright.yaml").write_text(yaml.safe_dump(text))
    done = CliRunner().invoke(app, [*call, "bright.yaml"])
    assert "saturates the detector at its faintest; put a filter" in str(done.exception)


@pytest.mark.slow
def test_a_gimbal_finds_itself(few):
    """Nothing in it knows a gantry: another geometry, whose light stands still."""
    axis = {"lower_deg": -180, "upper_deg": 180}
    axes = {"yaw": axis, "tilt": axis, "roll": axis, "detector": {"lower_deg": 10, "upper_deg": 170}}
    config = RigConfig.model_validate(
        {
            "name": "g",
            "depth": "devices",
            "kinematics": {"kind": "gimbal"},
            "axes": axes,
            "park_deg": {"detector": 90},
            "world": {"seed": 2},
        }
    )
    session = Session(config, (WEDGE,))
    for number, mirror in enumerate((Mirror(), Mirror.on_wedge(15))):
        rig = open_rig(config, mirror, 0)
        session.measure(rig, number)
        rig.close()
    poses = random_poses(config, 300, np.random.default_rng(0))
    right = truth(config)
    rms = [
        np.degrees(np.sqrt(np.mean(apart(right, k, poses) ** 2)))
        for k in (kinematics_of(config), session.fit.kinematics)
    ]
    assert rms[0] > 1 and rms[1] < 0.1


def test_peaks_found_before_a_ctrl_c_are_kept(tmp_path, monkeypatch, few):
    monkeypatch.chdir(tmp_path)
    observe, made = Looking.observe, []

    def interrupted(self, *args):
        if len(made) == 3:
            raise KeyboardInterrupt
        made.append(observe(self, *args))
        return made[-1]

    monkeypatch.setattr(Looking, "observe", interrupted)
    done = CliRunner().invoke(app, ["calibrate", "geometry", "--mirror", "--rig", "uncalibrated"])
    assert done.exit_code != 0
    assert len(read_observations(tmp_path / "calibrations/geometry-unfinished.csv", WRONG)) == 3


def test_backlash_of_the_yaml_is_not_counted_twice():
    """What a fit sees is the whole lag; the file says what is beyond the axis's own."""
    from gonio.rig.build import backlash_of

    axes = {n: a.model_copy(update={"backlash_deg": 0.3}) for n, a in WRONG.axes.items()}
    q = Parameters(WRONG.model_copy(update={"axes": axes}))
    p = np.zeros(len(q))
    p[[n.startswith("backlash") for n in q.names]] = np.radians(0.37)
    import datetime as dt

    made = GeometryCalibration(id="-", date=dt.datetime.now(dt.UTC), rig="-", **q.fields(p))
    np.testing.assert_allclose(np.degrees(backlash_of(q.config, made)), 0.37)
    np.testing.assert_allclose(q.of(q.inverse_of(made), "backlash"), np.radians(0.37))


def test_a_rig_that_reaches_no_mirror_pose_says_so(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    import yaml

    text = yaml.safe_load(find_config("sim", "rigs").read_text())
    for axis, (low, high) in {"light": (30, 60), "detector": (30, 60), "azimuth": (-60, 60)}.items():
        text["axes"][axis] |= {"lower_deg": low, "upper_deg": high}
    text["park_deg"] = {"light": 45, "detector": 45, "azimuth": 40}
    (tmp_path / "narrow.yaml").write_text(yaml.safe_dump(text))
    done = CliRunner().invoke(app, ["calibrate", "geometry", "--mirror", "--rig", "narrow.yaml"])
    assert "reaches no pose at which a mirror" in str(done.exception)


def test_a_table_that_tells_nothing_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "same.csv").write_text(
        "kind,light_deg,turntable_deg,detector_deg,azimuth_deg\n" + "mirror,30,0,-30,0\n" * 20
    )
    done = CliRunner().invoke(app, ["calibrate", "geometry", "same.csv", "--rig", "sim"], catch_exceptions=False)
    assert "that is little" in done.output
    (tmp_path / "zero.csv").write_text(
        "kind,light_deg,turntable_deg,detector_deg,azimuth_deg,x,y,z\n" + "light,30,0,-30,0,0,0,0\n" * 20
    )
    done = CliRunner().invoke(app, ["calibrate", "geometry", "zero.csv", "--rig", "sim"])
    assert "zero.csv:2: x, y, z are all 0" in str(done.exception)
