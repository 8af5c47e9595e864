"""The densities of cos theta_i that independence draws mix, and the one of them that is even in the angle."""

import numpy as np
import pytest
from oracle import exact_bins, glossy, p_value, run
from scipy.stats import chi2

from gonio.mcmc.plans.auto import IN_ANGLE, Auto, isotropic_dictionary, leant, log_lean
from gonio.mcmc.proposals.independence import ELEVATIONS, EVEN, Dictionary, Mixture, even_in_angle
from gonio.mcmc.target import Target

BRDF = glossy()


def mixture_of(elevation: int) -> Mixture:
    """One rough lobe, cosine and uniform, all of one elevation."""
    shares = np.zeros((len(ELEVATIONS), 3))
    shares[elevation] = 0.5, 0.3, 0.2
    return Mixture(Dictionary(np.array([0.4]), np.array([0.4])), shares)


def test_even_in_angle_by_value():
    mu = np.cos(np.radians([90.0, 60.0, 30.0, 5.0]))
    assert np.allclose(even_in_angle(mu), 2 / (np.pi * np.sin(np.radians([90.0, 60.0, 30.0, 5.0]))), rtol=1e-12)
    assert np.isfinite(even_in_angle(np.array([1.0, np.nextafter(1, 2)]))).all()


@pytest.mark.parametrize("k", range(len(ELEVATIONS)))
def test_the_inverse_is_that_of_the_cumulative(k):
    density, inverse = ELEVATIONS[k]
    u = np.linspace(0.02, 0.98, 49)
    for a, b in zip(inverse(u[:-1]), inverse(u[1:])):
        t = np.linspace(np.arccos(a), np.arccos(b), 401)
        y = density(np.cos(t)) * np.sin(t)
        assert abs(abs(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(t))) - 0.02) < 1e-6


@pytest.mark.parametrize("k", range(len(ELEVATIONS)))
def test_draws_follow_the_density(k):
    """Chi-square of theta_i in 30 cells of equal mass; weights 1 / q fill the hemispheres of wi and wo evenly."""
    n, density = 60_000, mixture_of(k)
    wi, wo = density.sample(np.random.default_rng(k).random((5, n)))
    edges = np.arange(1, 30) / 30
    cut = np.sort(ELEVATIONS[k][1](edges))
    seen = np.bincount(np.searchsorted(cut, wi[:, 2]), minlength=30)
    assert chi2.sf(np.sum((seen - n / 30) ** 2 / (n / 30)), 29) > 1e-4
    up = (wo[:, 2] > 0) & (wi[:, 2] > 0.2) & (wi[:, 2] < 0.98)
    w = np.exp(-density.log_prob(wi[up], wo[up])) / n
    cell = np.minimum(((wi[up, 2] - 0.2) / 0.78 * 4).astype(int), 3) * 3 + np.minimum((wo[up, 2] * 3).astype(int), 2)
    total, square = np.bincount(cell, w, 12), np.bincount(cell, w * w, 12)
    assert np.abs((total - 4 * np.pi**2 * 0.78 / 12) / np.sqrt(square)).max() < 4.5


def test_negative_control_a_wrong_elevation_is_found():
    n = 60_000
    wi, _ = mixture_of(0).sample(np.random.default_rng(0).random((5, n)))
    cut = np.sort(ELEVATIONS[EVEN][1](np.arange(1, 30) / 30))
    seen = np.bincount(np.searchsorted(cut, wi[:, 2]), minlength=30)
    assert chi2.sf(np.sum((seen - n / 30) ** 2 / (n / 30)), 29) < 1e-6


def test_leant_shares_and_surrogates_lean_alike():
    """The mixture's density times the lean, where the mixture is uniform in wi."""
    dictionary = isotropic_dictionary()
    shares = np.zeros((len(ELEVATIONS), dictionary.lobes))
    shares[0, [3, -2]] = 0.6, 0.4
    rng = np.random.default_rng(3)
    wi, wo = Mixture(dictionary, shares).sample(rng.random((5, 200)))
    up = wo[:, 2] > 0
    lean = Mixture(dictionary, leant(shares)).log_prob(wi[up], wo[up]) - Mixture(dictionary, shares).log_prob(
        wi[up], wo[up]
    )
    assert np.allclose(lean, log_lean(wi[up]), atol=1e-12)
    assert abs(leant(shares).sum() - 1) < 1e-12 and leant(shares)[EVEN].sum() >= IN_ANGLE * 0.999


def test_negative_control_a_lean_that_the_ratio_forgets_is_found(monkeypatch):
    """Draws from the leant mixture, weights of the one that does not lean."""
    target = Target(0, 1.0, 0.0, 1)
    bins = exact_bins(BRDF, target)
    monkeypatch.setattr("gonio.mcmc.plans.auto.IN_ANGLE", 0.5)
    assert p_value(run(Auto(block=8, anisotropic=False), BRDF, chains=3000, steps=40, seed=13), bins) > 1e-4

    right = Mixture.log_prob

    def forgetful(self, wi, wo):
        return right(self, wi, wo) - log_lean(wi)

    monkeypatch.setattr(Mixture, "log_prob", forgetful)
    assert p_value(run(Auto(block=8, anisotropic=False), BRDF, chains=3000, steps=40, seed=13), bins) < 1e-6
