"""Descriptions in YAML, and rigs that name one: what is wrong is one line with file, line and key."""

import json

import numpy as np
import pytest

from gonio.config import ConfigError, load_config
from gonio.config.instrument import Instrument, TextSection, factor_of, filled
from gonio.config.loader import parse_config
from gonio.config.material import Material
from gonio.config.rig import RigConfig
from gonio.run.record.config import RunConfig, dump

AXES = "light: {lower_deg: -88, upper_deg: 88}, turntable: {lower_deg: -180, upper_deg: 179.95}, "
AXES += "detector: {lower_deg: -88, upper_deg: 88}, azimuth: {lower_deg: -180, upper_deg: 179.95}"
RIG = f"name: k\ndepth: wire\naxes: {{{AXES}}}\n"


def rig(tmp_path, detector, rest=""):
    path = tmp_path / "rig.yaml"
    path.write_text(f"{RIG}detector:\n{detector}\n{rest}")
    return load_config(path, RigConfig)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("query: '?'\nanswer: '('", "2: answer: not a regular expression"),
        ("answer: '.*'", "answer: needs a group (?P<value>...)"),
        ("answer: '(?P<value2>.)'", "must be value1, value2, ... without a gap"),
        ("unit: 5 V", "unit: a unit is a word"),
        ("count: 5", "count: only for a group"),
        ('query: "a\\nb"', "query: one line of ASCII"),
        ("ranges: {full_scale: [2, 1], command: 'R{index}'}", "full_scale: each must be above the one before"),
        ("ranges: {full_scale: [1, 2]}", "command: missing; more than one range needs one"),
        (
            "ranges: {full_scale: [1, 2], command: 'R{inex}'}",
            "{inex} is not known here; there is {full_scale}, {index}",
        ),
        ("ranges: {full_scale: [1], command: 'R{index.real}'}", "{index.real} is not known here"),
        ("integration: {command: 'T{value:.0f}', lowest: 5, highest: 2}", "lowest: lies above highest"),
        ("errors: {ask: 'E?', answer: '.*'}", "answer: needs a group (?P<code>...)"),
        ("serial: {buad: 9600}", "serial.buad: unknown key; did you mean baud?"),
        ("querry: '?'", "querry: unknown key; did you mean query?"),
        ("count: 4096", "less than or equal to 2048"),
    ],
)
def test_what_is_wrong_is_one_line(tmp_path, text, words):
    path = tmp_path / "meter.yaml"
    path.write_text(f"{text}\nname: meter\n")
    with pytest.raises(ConfigError) as e:
        load_config(path, Instrument)
    assert words in str(e.value) and "meter.yaml:" in str(e.value) and "\n" not in str(e.value)
    if text.startswith("query: '?'"):
        return
    with pytest.raises(ConfigError) as e:  # the rig that names it says so too
        rig(tmp_path, f"  kind: text\n  instrument: {path}")
    assert words[:20] in str(e.value) and "rig.yaml:6: detector.instrument" in str(e.value)


@pytest.mark.parametrize(
    ("detector", "words"),
    [
        ("  kind: text", "rig.yaml:4: detector.instrument: missing"),
        ("  kind: text\n  instrument: foo", "rig.yaml:6: detector.instrument: foo: no such file"),
        ("  kind: text\n  instrumnt: foo", "detector.instrument: missing"),
        ("  kind: text\n  instrument: arduino_line\n  whit: 1", "rig.yaml:7: detector.whit: unknown key; did you mean"),
        ("  kind: text\n  instrument: arduino_line\n  port: tcp://a", "rig.yaml:7: detector.port: expected tcp://HOST"),
        ("  kind: text\n  instrument: arduino_line\n  white: 0", "rig.yaml:7: detector.white: input should be greater"),
    ],
)
def test_what_is_wrong_in_a_rig(tmp_path, detector, words):
    with pytest.raises(ConfigError) as e:
        rig(tmp_path, detector)
    assert words in str(e.value) and "\n" not in str(e.value)


def test_a_run_keeps_the_whole_description(tmp_path):
    config = rig(tmp_path, "  kind: text\n  instrument: keithley_6485\n  white: 3e-7", "exposure_s: 1e-1\n")
    assert config.channels == 1 and config.detector_kind == "text" and config.steps == 200000
    np.testing.assert_allclose(config.full_scales[0], 2e-9 / 3e-7)
    text = dump(RunConfig(material=Material(name="felt", channels=["Y"]), rig=config))
    assert parse_config(text, RunConfig).rig == config
    assert "CURR:RANG" in text


def test_depths_that_have_no_wire(tmp_path):
    for depth in ("ideal", "devices"):
        path = tmp_path / "rig.yaml"
        path.write_text(RIG.replace("wire", depth) + "detector: {kind: text, instrument: arduino_line}\n")
        with pytest.raises(ConfigError, match="has no wire to one; take depth wire or real"):
            load_config(path, RigConfig)


def test_units_and_templates():
    assert factor_of("nA", "A") == pytest.approx(1e-9) and factor_of("mW", "uW") == pytest.approx(1e3)
    assert factor_of("counts", "counts") == 1 and factor_of("m", "m") == 1
    with pytest.raises(ValueError, match="no unit of"):
        factor_of("V", "A")
    assert filled("R{index:.0f};{full_scale:.1E}", index=2, full_scale=2e-9) == "R2;2.0E-09"
    with pytest.raises(ValueError):
        filled("{0}", index=1)


def test_a_mutated_description_is_read_or_refused(tmp_path):
    """300 damaged copies of one that ships: an Instrument, or one line."""
    from tests.conftest import ROOT

    rng = np.random.default_rng(1)
    whole = (ROOT / "configs/instruments/keithley_6485.yaml").read_bytes()
    path = tmp_path / "m.yaml"
    refused = 0
    for _ in range(300):
        data = bytearray(whole)
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(len(data)))
            match int(rng.integers(3)):
                case 0:
                    data[at] = int(rng.integers(256))
                case 1:
                    del data[at : at + int(rng.integers(1, 200))]
                case 2:
                    data[at:at] = [b"nan", b"[[", b"{", b"\xff", b"1e999", b": &a", b"*a", b"\n  - "][
                        int(rng.integers(8))
                    ]
        path.write_bytes(data)
        try:
            load_config(path, Instrument)
        except ConfigError as e:
            refused += 1
            assert "\n" not in str(e) and "m.yaml" in str(e)
    assert refused > 100


def test_the_port_of_a_calibrated_rig_may_change(tmp_path):
    from gonio.rig.stale import made_for

    one = rig(tmp_path, "  kind: text\n  instrument: keithley_6485")
    other = rig(tmp_path, "  kind: text\n  instrument: keithley_6485\n  port: /dev/ttyX")
    dimmer = rig(tmp_path, "  kind: text\n  instrument: keithley_6485\n  white: 2")
    assert made_for("radiometry", one) == made_for("radiometry", other) != made_for("radiometry", dimmer)
    assert isinstance(one.detector, TextSection) and json.loads(one.model_dump_json())["detector"]["driver"] == "text"
