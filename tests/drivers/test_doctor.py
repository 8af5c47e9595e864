"""The doctor on emulated patients."""

import pytest

from drivers.doctor import _latency, doctor
from gonio.brdf.lambert import Lambert
from gonio.config.rig import DevicesConfig
from sim.sample import Sample
from sim.wire.rig import Emulators
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
    assert all(s.get(64) == 0 and s.get(116) == round(s.position(0)) for s in there.servos.values())  # nothing moved
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
    import numpy as np

    there.sample_zero = np.zeros(3)
    ail(there)
    assert any(said in line for line in findings(there)), findings(there)
    assert not there.light.lamp.lit


def test_nothing_configured():
    lines = doctor(CONFIG, DevicesConfig())
    assert lines[0].startswith("FAIL stage: none is configured") and any("warn photodiode: none" in x for x in lines)


@pytest.mark.parametrize(("ms", "said"), [(16, "warn stage: USB latency timer is 16 ms"), (1, "ok   stage: USB")])
def test_latency_timer(tmp_path, ms, said):
    (tmp_path / "ttyUSB0").mkdir()
    (tmp_path / "ttyUSB0" / "latency_timer").write_text(f"{ms}\n")
    assert next(iter(_latency("/dev/ttyUSB0", tmp_path))).startswith(said)
    assert not list(_latency("/dev/ttyACM0", tmp_path))
