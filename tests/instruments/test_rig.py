"""A whole rig whose detector is an instrument that speaks text: doctor, a run, calibration, commands."""

import contextlib
import io
import json
import re
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.doctor import doctor
from gonio.brdf.models.lambert import Lambert
from gonio.cli import main
from gonio.config import load_config
from gonio.config.rig import RigConfig
from gonio.run.open_rig import open_rig
from sim.sample import Sample
from sim.wire.rig import Emulators
from tests.conftest import ROOT

CONFIG = load_config(ROOT / "configs/rigs/picoammeter.yaml", RigConfig)


def gonio(*args):
    """A command, in this process."""
    out, err, before = io.StringIO(), io.StringIO(), sys.argv
    sys.argv = ["gonio", *map(str, args)]
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), pytest.raises(SystemExit) as e:
            main()
    finally:
        sys.argv = before
    return SimpleNamespace(returncode=e.value.code, stdout=out.getvalue(), stderr=err.getvalue())


@pytest.fixture
def there():
    emulators = Emulators(CONFIG, Sample(Lambert([0.3])), 1)
    yield emulators
    emulators.close()


def test_a_healthy_instrument(there):
    lines = doctor(there.config, there.devices)
    text = "\n".join(lines)
    assert "FAIL" not in text, text
    for said in (
        "ok   keithley_6485: on ",
        "says 'KEITHLEY INSTRUMENTS INC.,MODEL 6485",
        "ok   keithley_6485: reads 3.0",
        "ok   text: 1 channels, dark level 0.001",
        "ok   light: on/off contrast 2",
    ):
        assert said in text, text
    assert not there.light.lamp.lit


@pytest.mark.parametrize(
    ("ail", "said"),
    [
        (lambda t: setattr(t.instrument, "silent", True), "FAIL keithley_6485: no reply to *IDN?; check its cable"),
        (lambda t: setattr(t.instrument, "altered", lambda a: "huh"), "FAIL keithley_6485: says 'huh' to *IDN? on"),
        (lambda t: t.server.unplug(t.lines["instrument"]), "is not there; plug it in, or name one of those found"),
        (lambda t: setattr(t.meter, "scene", lambda: np.full(1, 0.5)), "warn text: dark level should be about 0.001"),
        (lambda t: setattr(t.meter, "scene", lambda: np.zeros(1)), "FAIL light: switching it on changes nothing"),
    ],
)
def test_what_ails_it_is_named(there, ail, said):
    ail(there)
    lines = doctor(there.config, there.devices)
    assert any(said in line for line in lines), lines
    assert not there.light.lamp.lit


def test_it_measures_what_is_there():
    """f of a diffuser, within the sigma that it says; ranges as the photodiode's; the dark taken off."""
    rig = open_rig(CONFIG, Lambert([0.1]), 1)
    wi = np.array([[np.sin(t), 0, np.cos(t)] for t in np.radians(np.linspace(5, 86, 12))])
    wo = np.array([[-np.sin(t), 0, np.cos(t)] for t in np.radians(np.linspace(60, 0, 12))])
    seen = list(rig.visit(wi, wo, np.arange(12)))
    rig.close()
    f, sigma = np.array([v.f[0, 0] for v in seen]), np.array([v.sigma[0, 0] for v in seen])
    off = (f - 0.1 / np.pi) / sigma
    assert np.abs(off).max() < 4 and 0.4 < off.std() < 1.7
    raw = [v.raw[0] for v in seen]
    assert {r["exposure_s"] for r in raw} == {0.02} and len({r["range"][0] for r in raw}) > 1
    assert all(r["reply"].startswith("+") for r in raw)


def test_an_arduino_that_sends_by_itself_measures_too():
    """500 counts of a white diffuser, 1,023 at most: steps of 0.2 % and one range."""
    text = {**CONFIG.model_dump(mode="json"), "name": "arduino", "detector": {
        "kind": "text", "instrument": "arduino_line", "white": 500.0, "boot_s": 0}}  # fmt: skip
    rig = open_rig(RigConfig.model_validate(text), Lambert([0.5]), 1)
    wi = wo = np.array([[0.0, 0.0, 1.0]])
    tilted = np.array([[np.sin(0.8), 0.0, np.cos(0.8)]])
    (seen,) = rig.visit(tilted, wo, np.arange(1))
    assert seen.f[0, 0] == pytest.approx(0.5 / np.pi, abs=5 * seen.sigma[0, 0]) and not seen.saturated[0]
    rig.close()
    rig = open_rig(RigConfig.model_validate(text), Lambert([3.0]), 1)
    (seen,) = rig.visit(tilted, wi, np.arange(1))
    assert seen.saturated[0] and seen.raw[0]["reply"] == "1023"
    rig.close()


@pytest.mark.slow
def test_a_run_and_its_products(tmp_path):
    """As an operator types it; the report, the budget and a resumed run know the instrument."""
    run = tmp_path / "run"
    sets = ["--set", "budget.measurements=80"]
    done = gonio("acquire", "grey_gloss", "--rig", "picoammeter", "--no-daemon", "--out", run, *sets)
    assert done.returncode == 0, done.stderr
    said = json.loads(gonio("evaluate", run, "--json").stdout)
    assert said["energy_mean"] < 0.3
    config = (run / "config.yaml").read_text()
    assert "driver: text" in config and "CURR:RANG" in config
    assert gonio("budget", run).returncode == 0
    more = gonio("resume", run, "--set", "budget.measurements=90", "--no-post")
    assert more.returncode == 0, more.stderr


@pytest.mark.slow
def test_its_radiometry_is_found(tmp_path):
    """Gain, dark and noise as the emulator has them; its ranges as sure as the maker says, whom no exposure checks."""
    from gonio.rig.calibration import RadiometryCalibration, load_calibration

    done = gonio("calibrate", "radiometry", "--rig", "picoammeter", "--f", "0.3", "--out", tmp_path, "--yes")
    assert done.returncode == 0, done.stderr
    (path,) = tmp_path.glob("radiometry-*.yaml")
    c = load_calibration(path, RadiometryCalibration)
    assert c.detector == "text" and len(c.range_ratios) == 8
    assert c.gain[0] == pytest.approx(np.pi / 0.02, rel=2e-3) and c.dark[0] == pytest.approx(1e-3 / 0.02, rel=1e-2)
    assert c.shot_noise == pytest.approx(0.002, rel=0.15) and c.read_noise == pytest.approx(1e-5, rel=0.3)
    assert c.linearity_sigma < 0.01 and max(c.range_ratios_sigma) < 0.01


def test_check_says_what_reads_and_refuses_a_misfit(tmp_path):
    said = gonio("check", "grey_gloss", "--rig", "picoammeter")
    assert "keithley_6485 (text), 8 ranges, unit A, 1 channel" in said.stdout, said.stdout + said.stderr
    three = gonio("check", "analytic_gloss", "--rig", "picoammeter")
    assert three.returncode == 2 and "the text of rig picoammeter 1; name as many in the material" in three.stderr
    rig = tmp_path / "rig.yaml"
    text = (ROOT / "configs/rigs/picoammeter.yaml").read_text()
    rig.write_text(text.replace("{kind: text, instrument: keithley_6485, white: 3.0e-7}", "{driver: foo, port: p}"))
    missing = gonio("check", "grey_gloss", "--rig", rig)
    assert missing.returncode == 2
    assert "detector.driver: foo is not installed; there is photodiode, text" in missing.stderr


def test_read_shows_one_reading(there, tmp_path):
    """`gonio read`, on the very lines of docs/instruments.md."""
    there.light.lamp.lit = True
    port = there.lines["instrument"].path
    done = gonio("read", "keithley_6485", "--port", port, "--times", "2")
    assert done.returncode == 0, done.stderr
    who, one, two = done.stdout.splitlines()
    assert who.startswith("keithley_6485  'KEITHLEY") and "A  range 3 of 8" in one and one.split()[1] == two.split()[1]
    said = json.loads(gonio("read", "keithley_6485", "--port", port, "--json").stdout)
    assert said["unit"] == "A" and said["reply"].startswith("+") and not said["overload"]
    page = (ROOT / "docs/instruments.md").read_text()
    yaml = page.split("```yaml\n")[1].split("```")[0]
    assert len(yaml.strip().splitlines()) <= 15
    (tmp_path / "my_meter.yaml").write_text(yaml)
    from tests.instruments.bench import Bench, answering

    b = Bench(tmp_path, str(tmp_path / "my_meter.yaml"), answering("+1.2345e-06 W", end="\r\n"))
    b.device.rows = [(re.compile("READ"), lambda: "+1.2345e-06 W"), *b.device.rows]
    done = gonio("read", tmp_path / "my_meter.yaml", "--port", b.line.path)
    assert done.returncode == 0 and "1.2345e-06  W" in done.stdout, done.stdout + done.stderr
    wrong = gonio("read", "keithley_6485", "--port", tmp_path / "none")
    assert wrong.returncode == 3 and wrong.stderr.count("\n") == 1 and "is gone" in wrong.stderr
    wrong = gonio("read", "keithley_6485", "--port", "tcp://x")
    assert wrong.returncode == 2 and "--port tcp://x: " in wrong.stderr and "expected tcp://HOST:PORT" in wrong.stderr
    b.close()
