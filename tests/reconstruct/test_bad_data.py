"""Bad data gets a result near the clean one, or a refusal in one line; never a NaN in a table."""

import numpy as np
import pytest
from truths import GLOSSY, energy_error, samples

from gonio.reconstruct import ReconstructionError, ReconstructionWarning, Samples, reconstruct
from gonio.reconstruct.clean import clean, remarks
from gonio.reconstruct.running import fit as fit_running
from gonio.reconstruct.splines.auto import Problem
from gonio.reconstruct.splines.isotropic import Isotropic
from gonio.reconstruct.splines.outliers import outliers

S = samples(GLOSSY, 1500)
RNG = np.random.default_rng(7)


@pytest.fixture(autouse=True)
def _same_numbers_in_any_order(monkeypatch):
    """Each test draws its own numbers, whichever ran before it in the same worker."""
    monkeypatch.setitem(globals(), "RNG", np.random.default_rng(7))


def changed(f=None, sigma=None, saturated=None, index=slice(None)) -> Samples:
    return Samples.of(S.wi[index], S.wo[index], (S.f if f is None else f)[index], sigma, saturated)


def with_outliers():
    hit = RNG.random(len(S)) < 0.01
    return changed(np.where(hit[:, None], 100 * S.f, S.f), S.sigma)


def with_nans():
    f = S.f.copy()
    f[::20] = np.nan
    return changed(f, S.sigma)


def saturated_peaks():
    top = np.quantile(S.f.max(1), 0.98)
    return changed(np.minimum(S.f, top), S.sigma, (S.f > top).any(1))


def duplicated():
    again = np.concatenate([np.arange(len(S)), np.repeat(3, 3000)])
    noise = S.sigma[again] * RNG.standard_normal((len(again), 3))
    return Samples.of(S.wi[again], S.wo[again], S.f[again] + noise, S.sigma[again])


@pytest.fixture(scope="module")
def clean_error():
    return energy_error(fit_running(S), GLOSSY)


@pytest.mark.parametrize("make", [with_nans, duplicated, lambda: changed(), lambda: changed(sigma=np.nan)])
def test_near_the_clean_result(make, clean_error):
    assert energy_error(fit_running(make()), GLOSSY) < 2 * clean_error


@pytest.mark.slow
@pytest.mark.parametrize("make", [with_outliers, saturated_peaks])
def test_near_the_clean_result_by_the_whole_way(make, clean_error):
    got = reconstruct(make())
    assert energy_error(got, GLOSSY) < 2 * clean_error
    assert all(np.isfinite(v).all() for v in got.to_arrays().values())


def test_outliers_are_found_and_good_readings_are_not():
    hit = np.zeros(len(S), bool)
    hit[10::100] = True
    f = np.where(hit[:, None], 100 * S.f, S.f)
    for values, most_wrong in ((f, 0), (S.f, 0)):
        p = Problem.of(changed(values, S.sigma), Isotropic(), np.random.default_rng(0))
        marked = outliers(p.frame.stretch(0.1)(p.angles), p.y, np.random.default_rng(0))
        assert (marked & ~hit).sum() <= most_wrong
        if values is f:
            assert (marked & hit).sum() >= 0.8 * hit.sum()


def test_saturated_readings_are_bounds_not_values():
    s = saturated_peaks()
    got = reconstruct(s)
    bound = s.f[s.saturated]
    assert (got.eval(s.wi[s.saturated], s.wo[s.saturated]) > 0.9 * bound).mean() > 0.9
    assert got.notes["saturated"] == s.saturated.sum()


def test_a_dead_channel_leaves_the_others_alone(clean_error):
    f = S.f.copy()
    f[:, 2] = 0
    got = reconstruct(changed(f, S.sigma))
    value, want = got.eval(S.wi, S.wo), GLOSSY.eval(S.wi, S.wo)
    assert value[:, 2].max() < 1e-2 * want[:, 2].mean()
    value, want = value * S.wo[:, 2:], want * S.wo[:, 2:]
    gap = np.abs(value - want)[:, :2].sum() / want[:, :2].sum()
    assert gap < 0.02


@pytest.mark.parametrize(
    "make, words",
    [
        (
            lambda: changed(sigma=np.where(np.arange(len(S))[:, None] < 9, np.nan, S.sigma)),
            "9 of 1500 samples have a sigma that",
        ),
        (
            lambda: changed(sigma=np.where(np.arange(len(S))[:, None] < 9, np.inf, S.sigma)),
            "9 of 1500 samples have an infinite",
        ),
        (lambda: Samples.of(S.wi, 1.001 * S.wo, S.f), "1500 of 1500 samples have directions up to a percent off"),
        (with_nans, "75 of 1500 samples without a finite value"),
        (
            lambda: Samples.of(np.where(np.arange(len(S))[:, None] < 9, -S.wi, S.wi), S.wo, S.f),
            "9 of 1500 samples with a direction",
        ),
    ],
)
def test_what_is_done_to_odd_samples_is_said(make, words):
    with pytest.warns(ReconstructionWarning) as caught:
        reconstruct(make(), "ggx")
    assert len(caught) == 1 and str(caught[0].message).startswith(words)


def test_good_samples_are_not_remarked_on():
    assert remarks(S) == []


def test_a_sample_of_infinite_sigma_has_no_say():
    f = S.f.copy()
    f[:9] = 1e6
    sigma = np.where(np.arange(len(S))[:, None] < 9, np.inf, S.sigma)
    assert np.array_equal(clean(changed(f, sigma)).f, clean(S[9:]).f)


def test_tiny_reflectances_do_not_overflow():
    """A power of 1e-300 did: the base was then that of another material."""
    with np.errstate(over="raise", divide="raise", invalid="raise"):
        got = fit_running(changed(1e-300 * S.f, 1e-300 * S.sigma))
    assert np.allclose(1e300 * got.eval(S.wi, S.wo), fit_running(S).eval(S.wi, S.wo), rtol=1e-6)


@pytest.mark.parametrize("scale", [1e-200, 1e-6, 1e6, 1e200])
def test_units_do_not_matter(scale):
    a, b = fit_running(S), fit_running(changed(scale * S.f, scale * S.sigma))
    assert np.allclose(scale * a.eval(S.wi, S.wo), b.eval(S.wi, S.wo), rtol=0.02)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: changed(index=slice(0, 19)), "19 usable samples"),
        (lambda: changed(np.full_like(S.f, np.nan)), "0 usable samples"),
        (lambda: changed(0 * S.f), "zero or below"),
        (lambda: changed(-S.f), "zero or below"),
        (lambda: changed(saturated=np.ones(len(S), bool)), "0 usable samples"),
        (lambda: Samples.of(S.wi[[5] * 99] + 1e-5 * RNG.random((99, 3)), S.wo[[5] * 99], S.f[[5] * 99]), "one spot"),
        (lambda: Samples.of(S.wi[[5] * 99], S.wo[[5] * 99], S.f[[5] * 99]), "1 usable samples"),
        (lambda: Samples.of(-S.wi, S.wo, S.f), "0 usable samples"),
        (lambda: changed(sigma=np.where(np.arange(len(S))[:, None] == 7, -1e-3, S.sigma)), "sample 7, sigma: -0.001"),
        (lambda: Samples.of(S.wi, 1.02 * S.wo, S.f), "sample 0, wo: a direction of length 1.02"),
        (lambda: Samples.of(0 * S.wi, S.wo, S.f), "sample 0, wi: a direction of length 0"),
        (lambda: changed(1e-310 * S.f), "is no reflectance"),
        (lambda: changed(np.where(np.arange(len(S))[:, None] == 7, S.f, 0)), "stand alone among 1499"),
    ],
)
def test_refused_in_one_line(make, words):
    with pytest.raises(ReconstructionError) as error:
        reconstruct(make())
    assert words in str(error.value) and "\n" not in str(error.value)


def test_replicates_are_averaged_by_their_noise():
    wi, wo = S.wi[:40], S.wo[:40]
    f = np.concatenate([np.full((40, 3), 1.0), np.full((40, 3), 4.0)])
    sigma = np.concatenate([np.full((40, 3), 1.0), np.full((40, 3), 2.0)])
    s = clean(Samples.of(np.tile(wi, (2, 1)), np.tile(wo, (2, 1)), f, sigma))
    assert len(s) == 40
    assert np.allclose(s.f, (1 / 1 + 4 / 4) / (1 + 1 / 4))
    assert np.allclose(s.sigma, np.sqrt(1 / (1 + 1 / 4)))
