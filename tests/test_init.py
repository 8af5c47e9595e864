"""`gonio init`: what it writes loads, keeps its comments, says what was found, and never writes over anything."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from drivers.ports.finding import find
from gonio.brdf.models.lambert import Lambert
from gonio.config import Material, load_config
from gonio.config.find import SHIPPED
from gonio.config.rig import RigConfig
from gonio.config.templates import NOT_FOUND, material_yaml, rig_yaml
from sim.sample import Sample
from sim.wire.rig import Emulators

WIRE = load_config(SHIPPED / "rigs" / "wire.yaml", RigConfig)


def gonio(*args, cwd):
    command = [sys.executable, "-m", "gonio.cli", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=120)


@pytest.fixture(scope="module")
def there():
    emulators = Emulators(WIRE, Sample(Lambert([0.3, 0.2, 0.1])), 1)
    yield emulators
    emulators.close()


@pytest.fixture
def ports(there):
    d = there.devices
    return {"stage": d.stage.port, "photodiode": d.photodiode.port, "light": d.light.port}


def test_a_rig_of_what_answers_on_the_ports(there, ports, tmp_path):
    shuffled = [ports["light"], ports["stage"], "/dev/no-such-port", ports["photodiode"]]
    given = [word for port in shuffled for word in ("--ports", port)]
    done = gonio("init", "rig", "here", *given, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rig = load_config(tmp_path / "here.yaml", RigConfig)
    assert rig.devices.stage.port == ports["stage"] and rig.devices.stage.model == "XM430-W350"
    assert rig.devices.stage.ids == {"light": 1, "turntable": 2, "detector": 3, "azimuth": 4}
    assert rig.devices.photodiode.port == ports["photodiode"] and rig.devices.light.port == ports["light"]
    assert rig.depth == "real" and rig.calibration.radiometry is None
    text = (tmp_path / "here.yaml").read_text()
    assert "photodiode" in done.stdout and "3 channels" in text and "/dev/no-such-port" in text
    assert "gonio doctor" in text and text.count("#") > 10
    healthy = gonio("doctor", "--rig", "here.yaml", cwd=tmp_path).stdout
    assert "FAIL stage" not in healthy and "ok   photodiode" in healthy and "ok   light: on/off" in healthy
    assert all(s.get(64) == 0 for s in there.servos.values()), "no torque: nothing moves"


def test_servos_that_are_not_four(there, ports):
    there.bus.deaf.add(3)
    try:
        found = find([ports["stage"]], boot_s=0.05)
    finally:
        there.bus.deaf.clear()
    assert list(found.servos) == [1, 2, 4] and found.stage == ports["stage"] and "id 4" in found.lines[0]


def test_a_port_where_nobody_answers(there, ports):
    there.photodiode.silent = True
    try:
        found = find([ports["photodiode"]], boot_s=0.05)
    finally:
        there.photodiode.silent = False
    assert found.photodiode is None and "nobody that is known answers" in found.lines[0]


@pytest.mark.parametrize("kinematics", ["gantry", "gimbal"])
@pytest.mark.parametrize("detector", ["photodiode", "camera"])
def test_a_rig_without_looking(tmp_path, kinematics, detector):
    done = gonio("init", "rig", "--no-look", "--kinematics", kinematics, "--detector", detector, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rig = load_config(tmp_path / "lab.yaml", RigConfig)
    assert rig.kinematics.kind == kinematics and rig.detector == detector and rig.devices.stage.port == NOT_FOUND
    assert gonio("doctor", "--rig", "lab.yaml", cwd=tmp_path).returncode == 3


def test_ports_given_by_kind(tmp_path):
    args = ["--no-look", "--stage", "/dev/a b:c", "--photodiode", "/dev/p", "--light", "/dev/l"]
    assert gonio("init", "rig", "x", *args, cwd=tmp_path).returncode == 0
    devices = load_config(tmp_path / "x.yaml", RigConfig).devices
    assert (devices.stage.port, devices.photodiode.port, devices.light.port) == ("/dev/a b:c", "/dev/p", "/dev/l")


def test_a_material_that_check_takes(tmp_path):
    done = gonio("init", "material", "gloss", "--truth", "analytic_gloss", "--energy-error", 0.05, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "below 0.05" in gonio("check", "gloss.yaml", "--rig", "ideal", cwd=tmp_path).stdout
    assert gonio("init", "material", "felt", cwd=tmp_path).returncode == 0
    assert load_config(tmp_path / "felt.yaml", Material) == Material(name="felt")


@pytest.mark.parametrize(
    "odd",
    ["no", "007", "a: b", "# x", "1e4", "Zoë", "two\nlines", '"quoted"', "null", "y", "-", " ", "'", "\\", "1:30"],
)
def test_text_is_kept_as_it_is_given(odd):
    text = material_yaml("m", sample_id=odd, operator=odd, notes=odd, truth=odd, channels=["R", odd])
    found = yaml.safe_load(text)
    assert [found[k] for k in ("sample_id", "operator", "notes", "truth")] == [odd] * 4
    assert yaml.safe_load(rig_yaml("r", stage=odd))["devices"]["stage"]["port"] == odd
    material = Material.model_validate(found)
    assert material.channels == ("R", odd) and material.notes == odd


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["rig", "--kinematics", "robot"], ["--kinematics robot", "gantry, gimbal"]),
        (["rig", "--detector", "eye"], ["--detector eye"]),
        (["rig", "a b", "--no-look"], ["name"]),
        (["rig", "--no-look", "--out", "no/such/lab.yaml"], ["no/such/lab.yaml", "no folder"]),
        (["material", "x", "--symmetry", "round"], ["--symmetry round"]),
        (["material", "x", "--measurements", "0"], ["budget.measurements"]),
        (["material", "x", "--channels", ""], ["channels"]),
        (["material", "../x"], ["../x"]),
        (["material"], ["Usage"]),
    ],
)
def test_mistakes_write_nothing(tmp_path, args, words):
    done = gonio("init", *args, cwd=tmp_path)
    assert done.returncode == 2 and "Traceback" not in done.stderr and all(w in done.stderr for w in words), done.stderr
    assert not list(tmp_path.iterdir()) and not (tmp_path.parent / "x.yaml").exists()


def test_nothing_is_written_over(tmp_path):
    (tmp_path / "felt.yaml").write_text("mine")
    done = gonio("init", "material", "felt", cwd=tmp_path)
    assert done.returncode == 2 and "exists already" in done.stderr and "--force" in done.stderr
    assert (tmp_path / "felt.yaml").read_text() == "mine"
    assert gonio("init", "material", "felt", "--force", cwd=tmp_path).returncode == 0
    assert [p.name for p in Path(tmp_path).iterdir()] == ["felt.yaml"]
