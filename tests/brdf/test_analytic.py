"""Analytic BRDFs: samplers against their densities, energy, reciprocity, known values."""

import math

import numpy as np
import pytest
from brdf.halfsquare import integrals, p_value, sample_p_value

from gonio.brdf import Abc, Beckmann, Brdf, Ggx, Lambert, Mixture
from gonio.brdf.models.fresnel import conductor
from gonio.brdf.models.ndf import GgxNdf
from gonio.brdf.models.student import Student, StudentNdf
from gonio.geometry import from_angles

ALPHAS = [1e-3, 0.01, 0.1, 0.4, 1.0]
ANGLES = np.radians([1.0, 40.0, 80.0])


def directions(n, rng):
    z, phi = rng.random(n), 2 * np.pi * rng.random(n)
    return from_angles(np.arccos(z), phi)


def models():
    gold = {"eta": [0.18, 0.42, 1.37], "k": [3.42, 2.35, 1.77]}
    yield "lambert", Lambert([0.2, 0.5, 0.9]), 1.0
    for a in ALPHAS:
        yield f"ggx {a}", Ggx(a), a
        yield f"beckmann {a}", Beckmann(a), a
    yield "ggx 0.05 x 0.5", Ggx(0.05, 0.5, **gold), (0.05, 0.5)
    yield "beckmann 0.4 x 0.04", Beckmann(0.4, 0.04, f0=[0.9, 0.5, 0.1]), (0.4, 0.04)
    for gamma in (1.6, 4.0):
        yield f"student {gamma}", Student(0.1, 0.3, gamma=gamma), (0.1, 0.3)
    yield "abc", Abc([0.1, 0.2, 0.3], [5.0, 6.0, 7.0], 2000.0, 1.4), 0.03
    yield "abc c=1", Abc(0.1, 5.0, 300.0, 1.0), 0.08
    yield "mixture", Mixture([Lambert([0.3] * 3), Ggx(0.05, f0=[0.5, 0.4, 0.3])], [1, 3]), 0.07


CASES = [pytest.param(b, a, id=n) for n, b, a in models()]


@pytest.mark.parametrize("brdf, alpha", CASES)
def test_samples_follow_the_density(brdf, alpha):
    """Chi-square per cell; and wherever no draw is lost the density integrates to 1 within 1e-3."""
    n = 40_000
    for k, theta in enumerate(ANGLES):
        wi = from_angles(theta, 0.7)
        cells = integrals(brdf.pdf, wi, alpha, bins=16, fine=28)
        wo, p = brdf.sample(np.tile(wi, (n, 1)), np.random.default_rng(k).random((n, 2)))
        assert p_value(wo, p, wi, alpha, cells) > 1e-4, np.degrees(theta)
        kept = np.mean(p > 0)
        assert abs(cells.sum() - kept) < 1e-3 + 4 * np.sqrt(kept * (1 - kept) / n), np.degrees(theta)


def test_a_wrong_density_is_found_out():
    brdf, wi = Ggx(0.1), from_angles(0.7, 0.7)
    assert sample_p_value(brdf, wi, 0.1, pdf=Ggx(0.105).pdf) < 1e-6
    assert sample_p_value(brdf, wi, 0.1, pdf=lambda a, b: 1.05 * brdf.pdf(a, b)) < 1e-6


@pytest.mark.parametrize("brdf, alpha", CASES)
def test_reciprocal_and_dark_below(brdf, alpha):
    rng = np.random.default_rng(5)
    wi = directions(2000, rng)
    wo, _ = brdf.sample(wi, rng.random((2000, 2)))
    np.testing.assert_allclose(brdf.eval(wi, wo), brdf.eval(wo, wi), rtol=1e-6, atol=1e-12)
    assert np.all(brdf.eval(wi, wo * [1, 1, -1])[wo[:, 2] > 0] == 0)
    assert np.all(brdf.pdf(wi, wo * [1, 1, -1])[wo[:, 2] > 0] == 0)


def test_reciprocity_test_sees_a_model_that_is_not():
    rng = np.random.default_rng(5)
    wi, wo = directions(100, rng), directions(100, rng)
    f = lambda a, b: Ggx(0.3).eval(a, b) * a[:, 2:3]
    assert not np.allclose(f(wi, wo), f(wo, wi), rtol=1e-6)


@pytest.mark.parametrize("model", [Ggx, Beckmann])
@pytest.mark.parametrize("alpha", ALPHAS)
def test_white_furnace(model, alpha):
    """No surface gives back more light than it gets; a smooth mirror gives nearly all of it."""
    for theta in ANGLES:
        wi = from_angles(theta, 0.7)
        f_cos = lambda a, b: model(alpha).eval(a, b)[:, 0] * b[:, 2]
        albedo = integrals(f_cos, wi, alpha).sum()
        assert albedo <= 1 + 1e-3
        if alpha <= 0.01 and theta < 1:
            assert albedo > 0.99


def test_known_values():
    n = np.array([[0.0, 0.0, 1.0]])
    for alpha in (1e-4, 0.2, 1.0):
        assert Ggx(alpha).eval(n, n)[0, 0] == pytest.approx(1 / (4 * np.pi * alpha**2), rel=1e-12)
        assert Beckmann(alpha).eval(n, n)[0, 0] == pytest.approx(1 / (4 * np.pi * alpha**2), rel=1e-12)
    assert conductor(np.array([1.0]), 1.5, 0.0)[0] == pytest.approx(0.04, rel=1e-12)
    assert conductor(np.array([0.0]), 1.5, 0.0)[0] == pytest.approx(1.0)
    brewster = np.cos(np.arctan(1.5))
    rs = ((1 - 1.5**2) / (1 + 1.5**2)) ** 2
    assert conductor(np.array([brewster]), 1.5, 0.0)[0] == pytest.approx(rs / 2, rel=1e-9)


def test_sharpest_lobes_stay_finite():
    rng = np.random.default_rng(6)
    for alpha in (1e-4, 1e-3):
        wi = np.tile(from_angles(np.radians(89.9), 0.3), (5000, 1))
        wo, p = Ggx(alpha).sample(wi, rng.random((5000, 2)))
        assert np.isfinite(wo).all() and np.isfinite(p).all() and np.mean(p > 0) > 0.9
        assert np.isfinite(Ggx(alpha).eval(wi, wo)).all()


def test_student_slopes_by_value():
    """GGX where gamma is 2; else Lambda against its integral over the slopes' marginal density."""
    w = from_angles(np.radians([5.0, 40.0, 75.0, 89.0]), np.array([0.0, 1.0, 2.0, 3.0]))
    student, ggx = StudentNdf(0.3, 0.1, 2.0), GgxNdf(0.3, 0.1)
    np.testing.assert_allclose(student.smith_lambda(w), ggx.smith_lambda(w), rtol=1e-8)
    np.testing.assert_allclose(student.d(w), ggx.d(w), rtol=1e-12)
    for gamma in (1.6, 3.0, 8.0):
        ndf, expected = StudentNdf(0.3, 0.3, gamma), []
        t = (np.arange(400_000) + 0.5) / 400_000
        for v in w:
            mu = v[2] / (0.3 * np.hypot(v[0], v[1]))
            q = mu + (t / (1 - t)) ** 4  # (0, 1) -> (mu, infinity)
            step = 4 * (t / (1 - t)) ** 3 / (1 - t) ** 2 / len(t)
            marginal = (1 + q * q) ** -(gamma - 0.5)
            # normalised over all slopes by Euler's beta function
            total = np.sqrt(np.pi) * np.exp(math.lgamma(gamma - 1) - math.lgamma(gamma - 0.5))
            expected.append(np.sum((q - mu) * marginal * step) / total / mu)
        np.testing.assert_allclose(ndf.smith_lambda(w), expected, rtol=1e-3, atol=1e-9)
        # negative control: GGX's own masking is another
        assert not np.allclose(ggx.smith_lambda(w), expected, rtol=0.05)


def test_every_model_is_a_brdf():
    for _, brdf, _ in models():
        assert isinstance(brdf, Brdf)
