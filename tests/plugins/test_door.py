"""Drivers by name: sections of a rig's YAML, what is not installed, what is no driver."""

import pytest

from gonio.config import ConfigError
from gonio.config import plugins as door
from gonio.config.loader import parse_config
from gonio.config.material import Material
from gonio.config.rig import RigConfig
from gonio.run.prepare import prepare
from gonio.run.record.config import RunConfig, dump
from tests.conftest import ROOT

WIRE = (ROOT / "configs/rigs/wire.yaml").read_text()
MATERIAL = Material(name="felt", channels=["R", "G", "B"], truth="analytic_gloss")


class Entry:
    """As importlib.metadata has them; `load` gives `found`, or raises it."""

    def __init__(self, found):
        self.found, self.value = found, "package:Name"

    def load(self):
        if isinstance(self.found, Exception):
            raise self.found
        return self.found


class Lamp:
    class Config(door.LightSection):
        driver: str = "candle"
        wicks: int = 1


@pytest.fixture
def offers(monkeypatch):
    """offers(group, name, object): an entry point of an installed package."""
    known = {}
    monkeypatch.setattr(door, "_installed", lambda group: known.get(group, {}))
    return lambda group, name, found: known.setdefault(group, {}).update({name: Entry(found)})


def rig(text):
    return parse_config(WIRE + text, RigConfig, source="rig.yaml")


def test_a_section_is_read_by_its_own_driver(offers):
    offers("gonio.lights", "candle", Lamp)
    config = rig("devices:\n  light: {driver: candle, wicks: 1e1}\n")
    assert isinstance(config.devices.light, Lamp.Config) and config.devices.light.wicks == 10
    text = dump(RunConfig(material=MATERIAL, rig=config))
    assert parse_config(text, RunConfig).rig.devices.light.wicks == 10
    with pytest.raises(ConfigError, match=r"rig.yaml:\d+: devices.light.wiks: unknown key; did you mean wicks\?"):
        rig("devices:\n  light: {driver: candle, wiks: 1}\n")


def test_what_is_not_installed_is_refused_before_anything_moves(offers, tmp_path):
    """But a run that was made with it can be read: its samples need no driver."""
    for text, key in (
        ("detector: {driver: foo, x: 1}\n", "detector"),
        ("devices:\n  light: {driver: foo}\n", "devices.light"),
        ("devices:\n  stage: {driver: foo}\n", "devices.stage"),
    ):
        config = rig(text)
        with pytest.raises(ConfigError, match=f"{key}.driver: foo is not installed; there is "):
            prepare(MATERIAL, config, tmp_path / "run")
        assert parse_config(dump(RunConfig(material=MATERIAL, rig=config)), RunConfig).rig.name == "wire"


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (ImportError("no module named x"), r"package:Name cannot be imported \(ImportError: no module named x\)"),
        (object, "package:Name has no `Config`"),
        (type("NoSection", (), {"Config": dict}), "package:Name has no `Config`"),
    ],
)
def test_what_is_no_driver_is_named(offers, found, words):
    offers("gonio.detectors", "foo", found)
    with pytest.raises(ConfigError, match=f"driver foo: {words}"):
        door.driver("gonio.detectors", "foo")
    with pytest.raises(ConfigError, match=f"driver foo: {words}"):
        rig("detector: {driver: foo}\n")


def test_a_name_that_ships_is_not_taken(offers):
    offers("gonio.lights", "lamp", Lamp)
    assert door.driver("gonio.lights", "lamp") is not Lamp


def test_a_photodiode_may_be_named_like_the_others():
    here = rig("detector: {driver: photodiode, port: /dev/p, baud: 9600}\n")
    there = rig("devices:\n  photodiode: {port: /dev/p, baud: 9600}\n")
    assert here == there and here.detector == "photodiode"
    assert rig("detector: {driver: camera, device: /dev/v}\n").devices.camera.device == "/dev/v"
