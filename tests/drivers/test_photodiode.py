"""The photodiode's driver on an emulated instrument: ranges, and averages as the config asks for them."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.photodiode import Photodiode
from drivers.text_line import TextLine
from gonio.config.detectors import PhotodiodeConfig
from gonio.rig.clock import ScaledClock, VirtualClock
from gonio.rig.errors import DeviceFault
from gonio.rig.signal.averaging import readings_needed, sigma_of
from sim.photodiode import SimPhotodiode
from sim.wire.line import Line, Server
from sim.wire.photodiode import WirePhotodiode

EXPOSURE = 0.02
SIGNAL = np.array([1.0, 0.1, 0.03])


class Bench:
    def __init__(self, folder, signal=SIGNAL, scale=1e5, connect=True, **keys):
        self.config = PhotodiodeConfig(**keys)
        self.signal = np.array(signal, float)
        self.device = WirePhotodiode(
            self.config, lambda: self.signal, len(self.signal), EXPOSURE, 1, ScaledClock(scale)
        )
        self.line = Line(folder / "photodiode", self.device)
        self.server = Server([self.line])
        self.detector = Photodiode(TextLine("photodiode", str(self.line.path), 115200), self.config, EXPOSURE)
        if connect:
            self.detector.connect()

    def close(self):
        self.detector.close()
        self.server.close()


@pytest.fixture
def bench(tmp_path):
    made = []

    def make(**keys):
        made.append(Bench(tmp_path, **keys))
        return made[-1]

    yield make
    for b in made:
        b.close()


def read(bench, n):
    out = []
    for k in range(n):
        bench.device.announce(k)
        out.append(bench.detector.read())
    return out


@pytest.mark.parametrize("target", [0.02, 0.004])
def test_an_average_reaches_its_sigma(bench, target):
    b = bench(target_sigma=target, target_sigma_floor=0, max_readings=400)
    got = read(b, 40)
    sigma, value = np.array([r.sigma for r in got]), np.array([r.value for r in got])
    assert (sigma <= 1.02 * target * SIGNAL).all()  # as said
    np.testing.assert_allclose(value.std(0), sigma.mean(0), rtol=0.4)  # and as it is
    np.testing.assert_allclose(value.mean(0) - 1e-3, SIGNAL, rtol=5 * target / np.sqrt(40))
    n = {r.raw["readings"] for r in got}
    dimmest = np.hypot(0.005 * np.sqrt(0.03), 1e-4) / 0.03  # relative, of one reading
    assert max(n) <= np.ceil(1.3 * (dimmest / target) ** 2) and min(n) >= (0.75 * dimmest / target) ** 2


def test_without_a_target_one_reading(bench):
    assert {r.raw["readings"] for r in read(bench(), 5)} == {1}


def test_the_count_is_bounded_and_the_floor_counts(bench):
    b = bench(target_sigma=1e-5, max_readings=7)
    before = b.device.counter
    (r,) = read(b, 1)
    assert r.raw["readings"] == 7 and b.device.counter - before >= 7
    few, many = (PhotodiodeConfig(target_sigma=0.001, target_sigma_floor=f) for f in (1e-3, 0.0))
    dark = np.zeros(1), np.full(1, 1e-8), np.zeros(1)
    assert readings_needed(few, *dark, 0.02) == 1 and readings_needed(many, *dark, 0.02) == many.max_readings


def test_the_converters_steps_do_not_average_out():
    c = PhotodiodeConfig(target_sigma=0.01, target_sigma_floor=0, max_readings=1000)
    light, variance = np.ones(1), np.full(1, 4e-4)
    assert readings_needed(c, light, 0.99 * variance, np.zeros(1), 1e-3) == 4
    assert readings_needed(c, light, variance, np.full(1, 0.9e-4), 1e-3) == 5  # noise that hides the steps: they do
    assert readings_needed(c, light, np.full(1, 4e-5), np.full(1, 0.5e-4), 1e-3) == 1
    assert readings_needed(c, light, np.full(1, 3.9e-5), np.full(1, 0.9e-4), 1e-3) == 4
    assert readings_needed(c, light, np.full(1, 4e-5), np.full(1, 2e-4), 1e-3) == 1000
    np.testing.assert_allclose(sigma_of(np.full(1, 4e-5), np.full(1, 0.9e-4), 4), 0.01)


def test_the_time_is_bounded(bench, monkeypatch):
    """By the exposures that it would take; and where the instrument is slow, by the clock on the wall."""
    b = bench(target_sigma=1e-5, average_s=0.5)
    assert read(b, 1)[0].raw["readings"] == 25
    slow = bench(target_sigma=1e-5, average_s=0.3)
    seconds = itertools.count(0.0, 0.1)  # a tenth of a second goes by from one look at the clock to the next
    monkeypatch.setattr("drivers.photodiode.time", SimpleNamespace(monotonic=lambda: next(seconds)))
    assert slow.detector.read().raw["readings"] == 3


def test_an_overload_is_not_averaged(bench):
    b = bench(target_sigma=1e-4, ranges=1, full_scale=0.5)
    (r,) = read(b, 1)
    assert r.saturated and r.raw["readings"] == 1


def test_the_first_after_a_change_of_range_is_thrown_away(bench):
    b = bench(shot_noise=0.0, read_noise=0.0)
    for signal, ranges in ((1.0, 0), (100.0, 1), (1.0, 0), (3000.0, 2)):
        b.signal = np.full(3, signal)
        (r,) = read(b, 1)
        assert r.raw["range"] == [ranges] * 3
        np.testing.assert_allclose(r.value, signal + 1e-3, rtol=1e-3)  # an unsettled one shows 0.7 of it


def test_simulated_and_emulated_average_alike():
    """The two families take as many readings for the same light, and pay for them in rig seconds."""
    c = PhotodiodeConfig(target_sigma=0.004, target_sigma_floor=0)
    sim = SimPhotodiode(c, lambda: SIGNAL, VirtualClock(), EXPOSURE, 1)
    got = []
    for k in range(100):
        sim.announce(k)
        got.append(sim.read())
    value, sigma = np.array([r.value for r in got]), np.array([r.sigma for r in got])
    assert (sigma <= 1.02 * 0.004 * SIGNAL).all()
    np.testing.assert_allclose(value.std(0), sigma.mean(0), rtol=0.25)
    np.testing.assert_allclose(sim.clock.now(), EXPOSURE * sum(r.raw["readings"] for r in got))


def answering(bench, change):
    """The bench, its instrument answering what `change(fields)` makes of a reading; with a right checksum."""
    b = bench()

    def altered(answer):
        word, _, rest = answer.partition(" ")
        return f"{word} {','.join(change(rest.split(',')))}" if word in ("READ?", "FETC?") and rest else answer

    b.device.altered = altered
    return b


def counting(fields, last=[0]):  # noqa: B006 - it counts backwards from one call to the next
    last[0] -= 1
    return [str(last[0]), *fields[1:]]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: [*f[:2], "9", *f[3:]], "a range or an overload that does not exist"),
        (lambda f: ["7", *f[1:]], "its counter reads 7"),
        (counting, "is not a whole number"),
        (lambda f: [f[0], "5.000000E-01", *f[2:]], "it exposed for 0.5 s in place of 0.02"),
        (lambda f: [*f[:4], "-5", *f[5:]], "a signal that its range cannot hold"),
        (lambda f: [*f[:4], "1e30", *f[5:]], "a signal that its range cannot hold"),
        (lambda f: [*f[:4], "1_000", *f[5:]], "'1_000' is not a number"),
        (lambda f: [*f[:4], "nan", *f[5:]], "'nan' is not a number"),
        (lambda f: [*f[:2], "٣", *f[3:]], "no reply"),
        (lambda f: f[:-1], "8 numbers in place of 9"),
        (lambda f: [*f[:2], "1", *f[3:]], "its ranges are"),
    ],
)
def test_nonsense_with_a_right_checksum_is_named(bench, change, words):
    b = answering(bench, change)
    with pytest.raises(DeviceFault, match=f"photodiode: .*{words}"):
        read(b, 3)


@pytest.mark.parametrize(
    ("answer", "words"),
    [("ERR foo", "an error without a number"), ("ERR", "an error without a number"), ("ERR 12,too hot", "too hot")],
)
def test_an_error_with_or_without_a_number(bench, answer, words):
    b = bench()
    b.device.altered = lambda _: answer
    with pytest.raises(DeviceFault, match=f"photodiode: .*{words}"):
        read(b, 1)


@pytest.mark.parametrize("identity", ["gonio,photodiode,0,1", "a,b,c,d,0x3", "a,b,c,d,0", "a,b,c,d,1000", ""])
def test_somebody_else_on_its_port(tmp_path, identity):
    b = Bench(tmp_path)
    b.device.commands["*IDN?"] = lambda _: identity
    with pytest.raises(DeviceFault, match="says it is"):
        b.detector.connect()
    b.close()


def test_an_instrument_that_talks_all_the_time_is_named(bench, monkeypatch):
    """Left in its streaming mode: more lines come at every packet than can be read away."""
    b = bench()
    b.detector.line.boot_s = 0.0
    monkeypatch.setattr("drivers.text_line.LOUD_S", 0.0)
    b.device.receive = lambda data: [b"0.1234\r\n"] * 50
    with pytest.raises(DeviceFault, match=r"no reply that can be believed; '0\.1234' came instead"):
        read(b, 1)


def test_lines_that_were_not_asked_for_are_passed_over(bench):
    b = bench()
    receive = b.device.receive
    b.device.receive = lambda data: [b"0.1234\r\n", *receive(data), b"0.1235\r\n"]
    assert len(read(b, 20)) == 20


def test_an_instrument_that_boots_when_its_port_is_opened(tmp_path):
    """Deaf, then a banner, then as usual; and again after a USB reset in a run, its settings forgotten."""
    b = Bench(tmp_path, connect=False)
    b.device.boots = True
    b.device.restarted()
    b.detector.connect()
    b.signal = np.full(3, 100.0)  # not in the lowest range
    first = read(b, 3)
    b.line.plans[b.line.packets + 2] = lambda: b.server.flap(b.line)
    again = read(b, 3)
    assert b.detector.line.restarts == 2
    for r, s in zip(first, again):
        np.testing.assert_array_equal(r.value, s.value)
    b.close()


def test_one_that_answers_at_once_is_not_waited_for(bench):
    b = bench()
    assert b.detector.line.failures == 0


@pytest.mark.parametrize("moments", [(1, 2), (2, 3, 4), (1, 2, 3, 4, 5, 6)])
def test_absences_one_after_another(bench, moments):
    """Six in a row are more than the tries that a lost answer has."""
    b = bench()
    clean = read(b, 4)
    for k in moments:
        b.line.plans[b.line.packets + k] = lambda: b.server.flap(b.line)
    torn = read(b, 4)
    assert not b.line.plans
    for r, s in zip(clean, torn):  # as good as before; which noise it has depends on what was read twice
        np.testing.assert_allclose(r.value, s.value, atol=5 * r.sigma.max())
