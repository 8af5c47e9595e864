"""The doctor on emulated patients."""

from pathlib import Path

import numpy as np
import pytest

from drivers.doctor import doctor
from drivers.latency import too_slow
from gonio.brdf.models.lambert import Lambert
from gonio.config import load_config
from gonio.config.devices import CameraDeviceConfig, DevicesConfig
from gonio.config.rig import RigConfig
from gonio.run.open_rig import open_rig
from sim.camera import SimFrames
from sim.sample import Sample
from sim.wire.rig import Emulators
from tests.conftest import ROOT
from tests.drivers.bench import WIRE

CONFIG = WIRE.model_copy(update={"park_deg": {"light": -20.0, "detector": 30.0}})


@pytest.fixture
def there():
    emulators = Emulators(CONFIG, Sample(Lambert([0.3, 0.2, 0.1])), 1)
    yield emulators
    emulators.close()


def findings(there):
    return doctor(CONFIG, there.devices)


def test_a_healthy_rig(there):
    lines = findings(there)
    assert not [line for line in lines if line.startswith("FAIL")], lines
    text = "\n".join(lines)
    for said in ("light: XM430-W350 id 1, firmware 48, 12.0 V, 35 C, at -20.0", "dark level 0.00", "on/off contrast 2"):
        assert said in text
    assert all(
        s.get(64) == 0 and s.get(116) == round(s.position(there.clock.now())) for s in there.servos.values()
    )  # nothing moved
    assert not there.light.lamp.lit


@pytest.mark.parametrize(
    ("ail", "said"),
    [
        (lambda t: t.bus.deaf.add(3), "FAIL detector: no servo answers as id 3; check its cable, supply and id"),
        (lambda t: t.servos[2].put(0, 1060), "FAIL turntable: servo 2 is XL430-W250, not XM430-W350"),
        (lambda t: t.servos[2].put(144, 88), "FAIL turntable: 8.8 V is outside 9.5 to 16.0 V; check the supply"),
        (lambda t: t.servos[2].put(146, 75), "warn turntable: 75 C, it stops at 80 C"),
        (lambda t: t.servos[4].fail(5), "FAIL azimuth: overload; free the joint"),
        (lambda t: t.servos[1].hold(4000), "FAIL light: stands outside its limits"),
        (lambda t: setattr(t.photodiode, "silent", True), "FAIL photodiode: no reply; check its cable"),
        (lambda t: t.light.open_door(), "FAIL light: interlock open; close the door"),
        (lambda t: setattr(t.photodiode, "scene", lambda: 0 * t.sample_zero), "FAIL light: switching it on changes"),
        (lambda t: t.server.unplug(t.lines["light"]), "is not there; plug it in, or name one of those found"),
    ],
)
def test_what_ails_it_is_named(there, ail, said):
    there.sample_zero = np.zeros(3)
    ail(there)
    assert any(said in line for line in findings(there)), findings(there)
    assert not there.light.lamp.lit


def test_nothing_configured():
    lines = doctor(CONFIG, DevicesConfig())
    assert lines[0].startswith("FAIL stage: none is configured") and any("warn photodiode: none" in x for x in lines)


@pytest.mark.parametrize(("ms", "said"), [(16, "warn stage: USB latency timer is 16 ms"), (1, "ok   stage: USB")])
def test_latency_timer(there, tmp_path, monkeypatch, ms, said):
    port = Path(there.devices.stage.port).resolve().name
    monkeypatch.setattr("drivers.latency.SYS", tmp_path)
    assert not any("latency" in line for line in findings(there))  # an adapter that has none
    (tmp_path / port).mkdir()
    (tmp_path / port / "latency_timer").write_text(f"{ms}\n")
    assert any(line.startswith(said) for line in findings(there))
    slow = too_slow(there.devices.stage.port)
    assert (slow is None) is (ms == 1) and (not slow or f"echo 1 > {tmp_path / port}/latency_timer" in slow)


def test_a_slow_adapter_is_told_at_connect(monkeypatch, caplog):
    monkeypatch.setattr("drivers.rig.too_slow", lambda port: "USB latency timer is 16 ms")
    open_rig(CONFIG, Lambert([0.3, 0.2, 0.1]), 1).close()
    assert [r.message for r in caplog.records] == ["stage: USB latency timer is 16 ms"]


# ---- a camera

CAMERA = load_config(ROOT / "configs/rigs/camera.yaml", RigConfig).model_copy(update={"park_deg": CONFIG.park_deg})


@pytest.fixture
def eye(there):
    """An emulated camera that sees the emulated lamp."""
    lamp, c = there.light.lamp, CAMERA.camera
    return SimFrames(lambda: np.full(3, 0.5 * c.sensor.white_per_s * lamp.power()), c.sensor, (c.height, c.width, 3))


def camera_findings(there, eye, config=CAMERA):
    return [line for line in doctor(config, there.devices, eye) if "camera" in line or "light:" in line]


def test_a_camera_is_named_and_tested(there, eye):
    text = "\n".join(camera_findings(there, eye))
    assert "FAIL" not in text
    for said in (
        "ok   camera: simulated camera, offers 12 bits linear",
        "auto_exposure 1, gain 0, auto_white_balance 0, white_balance 5000",
        "exposures 0.0001 to 0.4096 s read back, dark level 21",
        "ok   light: on/off contrast 5",
        "ok   camera: linear to 0.",
        "warn camera: as drawn; run `gonio calibrate camera`",
    ):
        assert said in text, text
    assert not there.light.lamp.lit and eye.dead  # let go


def gamma(eye):
    plain = eye.frame
    eye.frame = lambda s: (4095 * (plain(s) / 4095.0) ** 0.45).astype(np.uint16)


def coarse(there, eye):
    eye.sensor = eye.sensor.model_copy(update={"electrons_per_count": 100.0})


@pytest.mark.parametrize(
    ("ail", "said"),
    [
        (lambda t, e: setattr(e, "dead", True), "FAIL camera: delivers no frames; check its cable"),
        (lambda t, e: e.stubborn.add("auto_exposure"), "FAIL camera: auto_exposure set to 1 reads 3"),
        (lambda t, e: e.stubborn.add("exposure"), "FAIL camera: exposure set to 1 reads 156"),
        (lambda t, e: setattr(e, "scene", lambda: np.full(3, 3e3)), "warn camera: the dark is 14% of full scale"),
        (lambda t, e: setattr(e, "scene", lambda: np.zeros(3)), "FAIL light: switching it on changes nothing"),
        (coarse, "counts hides no step of its converter"),
        (lambda t, e: gamma(e), "is its gamma fixed at linear?"),
        (lambda t, e: t.light.open_door(), "FAIL light: interlock open"),
    ],
)
def test_what_ails_a_camera_is_named(there, eye, ail, said):
    ail(there, eye)
    lines = camera_findings(there, eye)
    assert any(said in line for line in lines), lines
    assert not there.light.lamp.lit


def test_a_camera_that_is_not_there(there, tmp_path):
    assert "FAIL camera: none is configured; name it under devices.camera" in doctor(CAMERA, there.devices)
    devices = there.devices.model_copy(update={"camera": CameraDeviceConfig(device="/dev/v4l/by-id/none")})
    assert any("FAIL camera: /dev/v4l/by-id/none is not there; plug it in" in x for x in doctor(CAMERA, devices))
    (tmp_path / "video9").touch()  # no camera behind it
    devices = there.devices.model_copy(update={"camera": CameraDeviceConfig(device=str(tmp_path / "video9"))})
    assert any("video9 cannot be opened; check its cable" in x for x in doctor(CAMERA, devices))
