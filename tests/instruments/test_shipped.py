"""The descriptions that ship, each on an emulator that was made after the instrument's manual."""

import re

import numpy as np
import pytest

from gonio.config import ConfigError, load_config
from gonio.config.detectors import PhotodiodeConfig
from gonio.config.instrument import Instrument
from gonio.rig.errors import DeviceFault
from sim.wire.instruments import KINDS
from sim.wire.plain import PlainDevice
from tests.conftest import ROOT
from tests.instruments.bench import Bench

FILES = sorted((ROOT / "configs/instruments").glob("*.yaml"))
WHITE = {"keithley_6485": 1e-6, "thorlabs_pm100": 1e-4, "ophir_rs232": 1e-4}


@pytest.fixture
def bench(tmp_path):
    made = []

    def make(name, **keys):
        made.append(Bench(tmp_path, name, white=WHITE.get(name, 1.0), **keys))
        made[-1].detector.connect()
        return made[-1]

    yield make
    for b in made:
        b.close()


@pytest.mark.parametrize("path", FILES, ids=lambda p: p.stem)
def test_a_description_is_whole_and_says_its_source(path):
    i = load_config(path, Instrument)
    assert i.name == path.stem and len(i.source) > 40 and i.name in KINDS


@pytest.mark.parametrize("name", WHITE)
def test_ranges_are_found_from_anywhere(bench, name):
    """The same range and value by whatever way: up from the lowest, down from the highest, by a wrong prediction."""
    b = bench(name)
    full = b.detector.full_scale
    for signal in (0.8 * full[0], 0.5 * full[1], 0.85 * full[2], 0.3 * full[1], 0.05 * full[0]):
        b.signal = np.array([signal / WHITE[name]])
        seen = []
        for start in range(len(full)):
            b.detector.expect(np.array([0.85 * full[start] / WHITE[name]]))
            r = b.detector.read()
            seen.append((r.raw["range"], float(r.value[0] / r.raw["exposure_s"] * b.detector.exposure)))
            assert not r.saturated and r.raw["exposure_s"] > 0
        assert len(set(map(str, seen))) == 1, seen
        assert seen[0][0] == [int(np.searchsorted(0.9 * full, signal))]
        np.testing.assert_allclose(seen[0][1], signal / WHITE[name], rtol=2e-4)
        scale = r.raw["exposure_s"] / b.detector.exposure / WHITE[name]
        np.testing.assert_allclose(r.raw["full_scale"], full[seen[0][0]] * scale)


@pytest.mark.parametrize("name", WHITE)
def test_a_reading_belongs_to_its_measurement(bench, name):
    """With noise: the very same by whatever way its range was found, so that a resumed run reads what it would have."""
    noise = PhotodiodeConfig(read_noise=1e-3, shot_noise=1e-3, dark=0)
    b = bench(name, noise=noise)
    full = b.detector.full_scale
    for number, signal in enumerate((0.8 * full[0], 0.5 * full[1], 0.5 * full[2])):
        b.signal = np.array([signal / WHITE[name]])
        seen = set()
        for start in range(len(full)):
            b.detector.expect(np.array([0.5 * full[start] / WHITE[name]]))
            b.detector.instrument.sessions += start  # a range that is set anew, as at a start
            b.meter.announce(number)
            seen.add(float(b.detector.read().value[0]))
        assert len(seen) == 1


@pytest.mark.parametrize("name", WHITE)
def test_beyond_the_highest_range_is_saturated(bench, name):
    b = bench(name)
    b.signal = np.array([3 * b.detector.full_scale[-1] / WHITE[name]])
    r = b.detector.read()
    assert r.saturated and r.raw["range"] == [len(b.detector.full_scale) - 1]


@pytest.mark.parametrize(("name", "longest"), [("keithley_6485", 1.0), ("thorlabs_pm100", 9.0)])
def test_a_rate_is_made_a_signal_of_its_exposure(bench, name, longest):
    """Amperes do not grow with the time; the signal of an exposure does."""
    b = bench(name)
    for seconds in (0.06, 0.3, 20.0):
        r = b.detector.read(seconds)
        assert r.raw["exposure_s"] == pytest.approx(min(seconds, longest))
        np.testing.assert_allclose(r.value / r.raw["exposure_s"], b.signal / b.detector.exposure, rtol=2e-4)
    took = b.device.nplc * 0.02 if name == "keithley_6485" else b.device.count * 0.003
    assert took == pytest.approx(longest)


def test_readings_are_averaged(bench, tmp_path):
    noise = PhotodiodeConfig(read_noise=0.01, shot_noise=0, dark=0, target_sigma=0.02, target_sigma_floor=0)
    b = bench("keithley_6485", noise=noise)
    r = b.detector.read()
    assert r.raw["readings"] == 25 and r.sigma[0] == pytest.approx(0.002, rel=1e-3)
    assert abs(r.value[0] - 0.1) < 5 * 0.002


def test_a_keithley_that_was_left_in_disorder(bench):
    """Errors of somebody else's commands are read away, those of ours are not."""
    b = bench("keithley_6485")
    b.device.errors += ['-113,"Undefined header"', '-410,"Query interrupted"']
    b.detector.connect()
    b.device.rows = [(p, act) for p, act in b.device.rows if "NPLC" not in p.pattern]
    with pytest.raises(DeviceFault, match=r"keithley_6485: answered '-113,\"Undefined header\"' to CURR:NPLC"):
        b.detector.read(0.4)


def test_another_instrument_on_the_port(tmp_path):
    b = Bench(tmp_path, "keithley_6485")
    b.device.rows.insert(0, (re.compile(r"\*IDN\?"), lambda: "ACME,9"))
    b.detector.instrument.i = b.detector.i.model_copy(update={"timeout_s": 0.05})
    with pytest.raises(DeviceFault, match=r"says 'ACME,9' to \*IDN\? on .*check its port"):
        b.detector.connect()
    b.close()


def test_ophir_refuses_in_its_own_words(bench):
    b = bench("ophir_rs232")
    b.device.ranges = b.device.ranges[:1]  # another head
    with pytest.raises(DeviceFault, match=r"ophir_rs232: answered '\?PARAM ERROR' to \$WN 2; check its description"):
        b.detector.read()


def test_an_arduino_that_sends_by_itself(tmp_path):
    """Each reading is of a line that began after it was asked for: what lies in the buffer is of the past."""
    b = Bench(tmp_path, "arduino_line", PlainDevice([]), boot_s=0)
    said = iter(range(1000))
    more = b.detector.instrument.port._more

    def loop(seconds):  # whoever waits hears one more line
        if seconds > 0:
            b.server.say(b.line, f"{next(said)}\r\n".encode())
        return more(seconds)

    b.detector.instrument.port._more = loop
    b.detector.connect()
    b.server.say(b.line, b"7\r\n" * 50 + b"9")  # old lines, and one that has begun
    while not b.detector.instrument.port.begun:
        more(1.0)
    first = next(said)
    r = b.detector.read()
    assert r.value[0] == first + 2 and r.raw["full_scale"] == [1023.0]
    b.close()


def test_no_emulator_of_an_unknown_one(tmp_path):
    from sim.wire.instruments import instrument

    with pytest.raises(ConfigError, match="no emulator of foo on rigs of depth wire; there is keithley_6485"):
        instrument("foo", None)
