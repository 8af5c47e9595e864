"""Configs: every mistake is one line with file, line and key; nothing else ever comes out."""

import resource

import numpy as np
import pytest

from gonio.config import ConfigError, Material, load_config
from gonio.config.find import SHIPPED, find_config
from gonio.config.loader import parse_config
from gonio.config.rig import RigConfig

GOOD = (SHIPPED / "materials" / "chm_orange.yaml").read_text()


@pytest.mark.parametrize("path", sorted((SHIPPED / "materials").glob("*.yaml")), ids=lambda p: p.stem)
def test_materials_that_ship_load(path):
    assert load_config(path, Material).name == path.stem


@pytest.mark.parametrize("path", sorted((SHIPPED / "rigs").glob("*.yaml")), ids=lambda p: p.stem)
def test_rigs_that_ship_load(path):
    assert load_config(path, RigConfig).name == path.stem


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name: a\nsampelr: 3", ["config:2", "sampelr", "did you mean sampler"]),
        ("name: a\nsampler:\n  proposol: auto", ["config:3", "sampler.proposol", "proposal"]),
        ("name: a\nbudget:\n  measurements: -3", ["config:3", "budget.measurements", "-3"]),
        ("name: a\nseed: .nan", ["config:2", "seed", "nan"]),
        ("name: a\nbudget: {rig_hours: .inf}", ["config:2", "rig_hours"]),
        ("name: a\nsampler: {sigma: wide}", ["config:2", "sampler.sigma", "wide"]),
        ("name: a\nname: b", ["config:2", "twice"]),
        ("x: &a [1]\ny: *a", ["config:2", "aliases"]),
        ("name: a\nsampler: {target: {channels: 7}}", ["7", "3 channels"]),
        ("name: a\nsampler: {target: {channels: red}}", ["channels", "luminance", "red"]),
        ("name: a\nsampler: {flow: {weights: x.npz, start: zoo}}", ["sampler.flow.weights", "start: code"]),
        ("name: a\nsampler: fast", ["config:2", "thesis"]),
        ("name: ../../etc", ["config:1", "name"]),
        ("seed: 3", ["name", "missing"]),
        ("", ["expected keys"]),
        ("- 1", ["expected keys"]),
        ("name: 'a", ["config"]),
        ("a: " + "[" * 5000, ["config"]),
        ("name: a\nbudget: {measurements: null}", ["nothing would end"]),
    ],
)
def test_mistakes_are_explained_in_one_line(text, words):
    with pytest.raises(ConfigError) as e:
        parse_config(text, Material)
    message = str(e.value)
    assert "\n" not in message and all(w in message for w in words), message


@pytest.mark.parametrize(
    "written", ["007", "450", "1e4", "no", "null", "2026-11-26", "2026-13-45", "1:30", "1.50", "0x1F", "true"]
)
def test_a_key_that_can_only_be_text_takes_what_is_written(written):
    m = parse_config(f"name: a\nchannels: [{written}, B]", Material)
    assert m.channels == (written, "B")
    if written == "null":  # of a key that may be left out
        return
    assert parse_config(f"name: a\ntruth: {written}", Material).truth == written
    assert parse_config(GOOD, Material, [f"truth={written}", f"channels=[{written}]"]).channels == (written,)


def test_names_that_look_like_numbers():
    assert parse_config("name: 007\nchannels: [450, 550, 650]", Material).channels == ("450", "550", "650")
    assert parse_config("name: 007", Material).name == "007"
    assert parse_config(GOOD, Material, ["name=007"]).name == "007"
    assert parse_config("name: a\ntruth: null", Material).truth is None
    assert parse_config("name: a\nsampler: {target: {channels: 1}}", Material).sampler.target.channels == 1


def test_whole_numbers_with_an_exponent():
    assert parse_config("name: a\nbudget: {measurements: 1e4}", Material).budget.measurements == 10_000
    assert parse_config(GOOD, Material, ["budget.measurements=2.5e3"]).budget.measurements == 2500
    with pytest.raises(ConfigError, match=r"budget\.measurements"):
        parse_config(GOOD, Material, ["budget.measurements=1.5e0"])


def test_a_number_is_read_in_base_ten():
    assert parse_config("name: a\nseed: 010", Material).seed == 10
    assert parse_config("name: a\nsampler: {kappa: 0100}", Material).sampler.kappa == 100
    for key in ("seed", "sampler.kappa", "budget.rig_hours"):
        with pytest.raises(ConfigError, match=f"--set {key}: .*1:30"):
            parse_config(GOOD, Material, [f"{key}=1:30"])


def test_a_name_that_is_missing_is_not_called_null():
    for nothing in ("", "~", "''"):
        with pytest.raises(ConfigError, match="name"):
            parse_config(f"name: {nothing}", Material)
    assert parse_config("name: null", Material).name == "null"


def test_overrides():
    m = parse_config(
        GOOD, Material, ["sampler.proposal=pss_simple", "budget.measurements=7", "sampler.target.channels=1"]
    )
    assert (m.sampler.proposal, m.budget.measurements, m.sampler.target.channels) == ("pss_simple", 7, 1)
    for bad in ("budget.measurements", "=3", "a..b=1", "budget.measurements=[", "budget.measurments=3"):
        with pytest.raises(ConfigError, match="--set"):
            parse_config(GOOD, Material, [bad])


def test_thesis_preset_is_the_thesis():
    s = parse_config("name: a\nsampler: thesis", Material).sampler
    assert (s.proposal, s.sigma, s.global_share, s.boundary) == ("pss_simple", 0.05, 0.1, "wrap")
    assert (s.target.channels, s.target.floor, s.target.power) == (0, 0.0, 1.0)


def test_files_that_cannot_be_read(tmp_path):
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(ConfigError):
            load_config(path, Material)
    (tmp_path / "binary.yaml").write_bytes(b"name: \xff\xfe")
    with pytest.raises(ConfigError, match="byte 6"):
        load_config(tmp_path / "binary.yaml", Material)
    (tmp_path / "long.yaml").write_bytes(b" " * 2_000_000)
    with pytest.raises(ConfigError, match="too large"):
        load_config(tmp_path / "long.yaml", Material)
    with pytest.raises(ConfigError, match="chm_orange"):
        find_config("nothing_like_it", "materials")


def test_ten_thousand_mutations_give_a_config_or_one_line():
    rng = np.random.default_rng(20260101)
    base = GOOD.encode()
    tokens = [
        b"[",
        b"{",
        b"*a",
        b"&a ",
        b"!!python/object:os.system ",
        b": ",
        b"\n",
        b"\t",
        b"~",
        b".nan",
        b"1e400",
        b"'",
        b'"',
        b"\x00",
        b"\xff",
        b"<<: ",
        b"9" * 400,
        b"- ",
        b"? ",
        b"%TAG",
        b"0x",
        b"2024-99-99",
        b"|",
        b">",
    ]
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    loaded = 0
    for _ in range(10_000):
        data = bytearray(base)
        for _ in range(rng.integers(1, 6)):
            at = rng.integers(0, len(data) + 1)
            match rng.integers(0, 4):
                case 0:
                    del data[at : at + rng.integers(1, 20)]
                case 1:
                    data[at:at] = tokens[rng.integers(len(tokens))]
                case 2 if at < len(data):
                    data[at] = rng.integers(0, 256)
                case _:
                    data[at:at] = data[rng.integers(0, len(data)) :][: rng.integers(1, 60)]
        try:
            parse_config(bytes(data).decode("utf-8", "replace"), Material)
            loaded += 1
        except ConfigError as e:
            assert "\n" not in str(e)
    assert 0 < loaded < 10_000
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 500_000  # KiB
