"""The drivers that ship keep what gonio.testing asks of a plug-in, on emulated devices; broken drivers are found."""

import tomllib

import numpy as np
import pytest

from drivers.doors import Dynamixel, Lamp, SerialPhotodiode, Text
from gonio.config.devices import LampConfig, PhotodiodePort, ServoBusConfig
from gonio.config.instrument import TextSection
from gonio.config.plugins import SECTIONS, SHIPPED, driver
from gonio.rig.clock import ScaledClock
from gonio.rig.devices import Reading
from gonio.rig.errors import DeviceFault
from gonio.testing import Nonconformity, check_detector, check_light, check_stage, setting
from sim.light import SimLight
from sim.wire.instruments import KINDS
from sim.wire.light import WireLight
from sim.wire.line import Line, Server
from sim.wire.meter import Meter
from sim.wire.photodiode import WirePhotodiode
from sim.wire.servo import Servo
from sim.wire.servo_bus import ServoBus
from tests.conftest import ROOT

CLOCK = ScaledClock(2000.0)
NOISE = {"photodiode": {"shot_noise": 0.002, "read_noise": 1e-4, "dark": 1e-3}}
WHITE = {"keithley_6485": 3e-7, "thorlabs_pm100": 1e-4, "ophir_rs232": 1e-4}


@pytest.fixture
def plug(tmp_path):
    """plug(device) -> port, fault, mend."""
    servers = []

    def put(device):
        line = Line(tmp_path / f"port{len(servers)}", device)
        servers.append(server := Server([line]))
        return str(line.path), lambda: server.unplug(line), lambda: server.plug(line)

    yield put
    for server in servers:
        server.close()


def test_dynamixel(plug):
    clock = ScaledClock(50.0)  # so slow that a poll finds the servos on their way
    s = setting(clock)
    ids = {a.name: k for k, a in enumerate(s.axes, 1)}
    port, fault, mend = plug(ServoBus({k: Servo(k, clock) for k in ids.values()}))

    def make():
        stage = Dynamixel(ServoBusConfig(port=port, ids=ids), s)
        stage.grace_s = 0.0
        return stage

    check_stage(make, fault=fault, mend=mend)


def test_photodiode(plug):
    s = setting(CLOCK, **NOISE)
    device = WirePhotodiode(s.rig.photodiode, lambda: np.array([1.0, 20.0]), 2, s.rig.exposure_s, 1, CLOCK)
    port, fault, mend = plug(device)
    check_detector(lambda: SerialPhotodiode(PhotodiodePort(port=port, boot_s=0), s), fault=fault, mend=mend)


@pytest.mark.parametrize("name", WHITE)
def test_text_instruments(plug, name):
    s = setting(CLOCK, **NOISE)
    meter = Meter(s.rig.photodiode, lambda: np.array([0.3]), WHITE[name], 1, CLOCK, s.rig.exposure_s)
    port, fault, mend = plug(KINDS[name](meter))
    section = TextSection(instrument=name, port=port, white=WHITE[name])
    check_detector(lambda: Text(section, s), fault=fault, mend=mend)


def test_lamp(plug):
    s = setting(CLOCK)
    device = WireLight(SimLight(s.rig.light, CLOCK))
    port, fault, mend = plug(device)
    config = LampConfig(port=port, boot_s=0)
    check_light(lambda: Lamp(config, s), lit=lambda: device.lamp.lit, fault=fault, mend=mend)


def test_the_door_is_one():
    """What pyproject.toml offers is what a source tree finds; sections are those of their drivers."""
    offered = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"]
    assert offered == SHIPPED
    for group, entries in SHIPPED.items():
        for name in entries:
            found = driver(group, name)
            module, _, attribute = SECTIONS[name].partition(":")
            assert found.Config is getattr(__import__(module, fromlist=["x"]), attribute)
            assert found.Config.model_fields["driver"].default == name


class Fine:
    """A detector without a device; each of those below breaks one promise."""

    Config = TextSection
    channels = 2

    def connect(self): ...

    def close(self): ...

    def expect(self, signal): ...

    def doctor(self):
        yield "ok   fine"

    def read(self, exposure=None):
        return Reading(np.ones(2), np.full(2, 0.01), False, {"exposure_s": exposure or 0.1})


def test_a_fine_detector_passes():
    check_detector(Fine)


def reading(**changes):
    def read(self, exposure=None):
        r = {"value": np.ones(2), "sigma": np.full(2, 0.01), "saturated": False, "raw": {"exposure_s": exposure or 0.1}}
        return Reading(**{**r, **changes})

    return {"read": read}


def counting(self, exposure=None):
    type(self).n = getattr(type(self), "n", 0) + 1
    return Reading(np.full(2, float(self.n)), np.full(2, 0.01), False, {"exposure_s": 0.1})


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"Config": None}, "Config: no section"),
        ({"channels": 0}, "channels: 0 after connect"),
        (reading(value=np.ones(3)), "value is no float64 array of shape (2,)"),
        (reading(sigma=np.array([-1.0, 1.0])), "sigma is not finite and at least 0"),
        (reading(value=np.array([np.nan, 1.0])), "value is not finite, and not saturated"),
        (reading(raw={}), "raw['exposure_s'] is missing"),
        (reading(raw={"exposure_s": 5.0}), "read(0.1): raw['exposure_s'] is 5"),
        (reading(raw={"exposure_s": 0.1, "x": np.ones(2)}), "raw is not JSON"),
        (reading(raw={"exposure_s": 0.1, "full_scale": [1.0]}), "raw['full_scale'] is not one a channel"),
        ({"read": counting}, "read after expect(None)"),
        ({"doctor": lambda self: iter(())}, "doctor: says nothing"),
        ({"doctor": lambda self: iter(["fine"])}, "doctor: 'fine' does not begin with ok, warn or FAIL"),
    ],
)
def test_a_broken_detector_is_found(change, words):
    with pytest.raises(Nonconformity) as e:
        check_detector(type("Broken", (Fine,), change))
    assert words in str(e.value)


@pytest.mark.parametrize("error", [None, OSError("gone"), DeviceFault("a", "b\nc", "d")])
def test_a_fault_that_is_none_is_found(error):
    broken = []

    def read(self, exposure=None):
        if broken and error:
            raise error
        return Fine.read(self, exposure)

    with pytest.raises(Nonconformity, match="a device that broke: "):
        check_detector(type("Broken", (Fine,), {"read": read}), fault=lambda: broken.append(1))
