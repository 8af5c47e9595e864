"""What is known and what is not: intervals hold where nothing was measured, and the estimate speaks of the whole."""

import numpy as np
import pytest
from truths import GLOSSY, samples

from gonio.evaluate import evaluate
from gonio.geometry import from_angles
from gonio.reconstruct import Samples, reconstruct
from gonio.reconstruct.running import fit as fit_running


def hemisphere(n: int, rng, most_deg: float = 88.0):
    """Directions uniform in solid angle, down to an angle."""
    z = rng.uniform(np.cos(np.radians(most_deg)), 1, n)
    return from_angles(np.arctan2(np.sqrt(1 - z * z), z), 2 * np.pi * rng.random(n))


class Film:
    """GLOSSY with a sheen towards grazing that no lobe of the base has: what is extrapolated is wrong."""

    channels = 3
    sample, pdf = GLOSSY.sample, GLOSSY.pdf

    def eval(self, wi, wo):
        rise = 1 + np.exp(-5 * wi[:, 2:]) + 0.3 * np.sin(5 * wo[:, 2:])
        return GLOSSY.eval(wi, wo) * rise


def all_over(rng):
    return hemisphere(1200, rng), hemisphere(1200, rng)


def in_plane(rng):
    a, b = rng.uniform(-85, 85, 1200), rng.uniform(0, 85, 1200)
    return from_angles(np.radians(b), 0 * b), from_angles(np.radians(np.abs(a)), np.where(a > 0, 0, np.pi))


def at_45(rng):
    wo = hemisphere(1200, rng)
    return np.broadcast_to(from_angles(np.pi / 4, 0.0), wo.shape), wo


def below_60(rng):
    return hemisphere(1200, rng, 60), hemisphere(1200, rng, 60)


@pytest.mark.parametrize("where", [all_over, in_plane, at_45, below_60])
def test_intervals_hold_also_where_nothing_was_measured(where):
    rng = np.random.default_rng(2)
    wi, wo = where(rng)
    f = Film().eval(wi, wo)
    got = reconstruct(Samples.of(wi, wo, f * (1 + 0.005 * rng.standard_normal(f.shape)), 0.005 * f))
    wi, wo = hemisphere(3000, rng), hemisphere(3000, rng)
    truth, before = Film().eval(wi, wo), None
    for level, least in ((0.68, 0.45), (0.95, 0.8), (0.99, 0.9)):
        low, high = got.interval(wi, wo, level)
        assert ((truth >= low) & (truth <= high)).mean() > least, level
        assert (low >= 0).all() and (high >= low).all()
        if before is not None:
            assert (low <= before[0]).all() and (high >= before[1]).all()
        before = low, high
    if where is all_over:
        error = evaluate(got, Film(), n=1000)["energy_mean"]
        assert 0.5 < got.energy_error_estimate / error < 2


@pytest.mark.parametrize("make", [reconstruct, fit_running])
def test_a_rig_that_ends_at_60_degrees_does_not_believe_itself(make):
    rng = np.random.default_rng(3)
    wi, wo = below_60(rng)
    f = Film().eval(wi, wo)
    narrow, whole = make(Samples.of(wi, wo, f, 0.005 * f)), make(samples(Film(), 1200))
    assert narrow.energy_error_estimate > 3 * whole.energy_error_estimate
    assert narrow.energy_error_estimate > 0.4 * evaluate(narrow, Film(), n=1000)["energy_mean"]


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [1.0, 10.0])
def test_noise_above_the_signal_is_in_the_intervals(sigma):
    """Half of the readings lie below 0: cut off there, they made the sample bright."""
    rng = np.random.default_rng(4)
    wi, wo = hemisphere(1500, rng), hemisphere(1500, rng)
    f = GLOSSY.eval(wi, wo)
    got = reconstruct(Samples.of(wi, wo, f + sigma * rng.standard_normal(f.shape), np.full(f.shape, sigma)))
    wi, wo = hemisphere(2000, rng), hemisphere(2000, rng)
    low, high = got.interval(wi, wo, 0.95)
    truth = GLOSSY.eval(wi, wo)
    assert ((truth >= low) & (truth <= high)).mean() > 0.85
    assert np.median(got.eval(wi, wo)) < 2 * sigma


def test_std_is_half_of_68_percent_and_levels_are_asked_for():
    got = reconstruct(samples(GLOSSY, 400))
    wi, wo = hemisphere(100, np.random.default_rng(5)), hemisphere(100, np.random.default_rng(6))
    low, high = got.interval(wi, wo, 0.6827)
    assert np.allclose(got.std(wi, wo), 0.5 * (high - low))
    assert not np.any(got.interval(-wi, wo, 0.9))
    for level in (0.0, 1.0, 95):
        with pytest.raises(ValueError, match="level must lie between 0 and 1"):
            got.interval(wi, wo, level)


@pytest.mark.parametrize("n", [30, 50])
def test_few_samples_are_no_nonsense(n):
    got = reconstruct(samples(GLOSSY, n))
    assert evaluate(got, GLOSSY, n=1000)["energy_mean"] < 1 and got.energy_error_estimate < 2
