"""Which servos are driven: every X series row, and those of protocol 1.0 named and refused in one line."""

import pytest

from drivers.doctor import doctor
from drivers.dynamixel import tables as t
from gonio.brdf.models.lambert import Lambert
from gonio.config import ConfigError
from gonio.config.devices import SERVOS, ServoBusConfig
from gonio.config.loader import parse_config
from gonio.rig.errors import DeviceFault
from sim.sample import Sample
from sim.wire.old_servo import WithOldServos
from sim.wire.rig import Emulators
from tests.drivers.bench import IDS, WIRE, Bench, pose


def test_the_config_knows_the_tables_rows():
    assert set(SERVOS) == set(t.MODELS) and len(set(t.MODELS.values())) == len(t.MODELS)


@pytest.mark.parametrize("model", ["XL330-M288", "XC330-T288", "XC430-W240", "XM540-W270"])
def test_a_stage_of_these(tmp_path, model):
    b = Bench(tmp_path)
    for servo in b.servos.values():
        servo.put(0, t.MODELS[model])
    b.stage.model = b.stage.servos.model = model
    b.stage.connect()
    b.stage.home()
    goal = pose(100, -50, 30, 0)
    assert b.stage.move(goal, 60.0) == pytest.approx(goal, abs=2e-3)
    b.close()


@pytest.mark.parametrize(("number", "name"), [(12, "AX-12A"), (29, "MX-28"), (4711, "model 4711")])
def test_protocol_1_is_named(tmp_path, number, name):
    b = Bench(tmp_path)
    del b.servos[IDS["turntable"]]
    b.line.device = WithOldServos(b.bus, {IDS["turntable"]: number})
    words = f"turntable: servo 2 is an {name}, which speaks protocol 1.0 and cannot be driven; take one of protocol 2.0"
    with pytest.raises(DeviceFault, match=words):
        b.stage.connect()
    b.close()


def test_the_doctor_names_it_too():
    there = Emulators(WIRE, Sample(Lambert([0.3, 0.2, 0.1])), 1)
    there.bus.deaf.add(2)
    there.lines["stage"].device = WithOldServos(there.bus, {2: 310})
    lines = doctor(WIRE, there.devices)
    assert any(x.startswith("FAIL turntable: servo 2 is an MX-64, which speaks protocol 1.0") for x in lines), lines
    assert any(x.startswith("ok   light: XM430-W350 id 1") for x in lines)
    there.close()


@pytest.mark.parametrize("model", ["AX-12A", "mx-28", "MX-64", "EX106"])
def test_protocol_1_in_the_yaml(model):
    with pytest.raises(
        ConfigError, match=f"2: model: servo {model} speaks protocol 1.0, which is not driven; take one of XM"
    ):
        parse_config(f"port: p\nmodel: {model}\nids: {{a: 1}}", ServoBusConfig)
    with pytest.raises(ConfigError, match="model: expected one of XM430-W350, "):
        parse_config("port: p\nmodel: XM431\nids: {a: 1}", ServoBusConfig)
