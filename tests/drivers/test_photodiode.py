"""The photodiode's driver on an emulated instrument: ranges, and averages as the config asks for them."""

import time

import numpy as np
import pytest

from drivers.photodiode import Photodiode
from drivers.text_line import TextLine
from gonio.config.detectors import PhotodiodeConfig
from gonio.rig.clock import ScaledClock, VirtualClock
from gonio.rig.signal.averaging import readings_needed, sigma_of
from sim.photodiode import SimPhotodiode
from sim.wire.line import Line, Server
from sim.wire.photodiode import WirePhotodiode

EXPOSURE = 0.02
SIGNAL = np.array([1.0, 0.1, 0.03])


class Bench:
    def __init__(self, folder, signal=SIGNAL, scale=1e5, **keys):
        self.config = PhotodiodeConfig(**keys)
        self.signal = np.array(signal, float)
        self.device = WirePhotodiode(
            self.config, lambda: self.signal, len(self.signal), EXPOSURE, 1, ScaledClock(scale)
        )
        self.line = Line(folder / "photodiode", self.device)
        self.server = Server([self.line])
        self.detector = Photodiode(TextLine("photodiode", str(self.line.path), 115200), self.config, EXPOSURE)
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


def test_the_time_is_bounded(bench):
    """By the exposures that it would take; and where the instrument is slow, by the clock on the wall."""
    b = bench(target_sigma=1e-5, average_s=0.5)
    assert read(b, 1)[0].raw["readings"] == 25
    slow = bench(target_sigma=1e-5, average_s=0.3, scale=0.5)  # each reading takes twice as long as it should
    begun = time.monotonic()
    n = slow.detector.read().raw["readings"]
    assert 2 <= n < 15 and time.monotonic() - begun >= 0.3


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
