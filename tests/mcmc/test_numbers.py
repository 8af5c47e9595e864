"""Random numbers by step, the vMF density, diagnostics against ArviZ."""

import numpy as np
import pytest
from scipy import stats
from scipy.integrate import quad

from gonio.brdf.models.spherical import log_vmf, log_vmf_between, sample_vmf
from gonio.mcmc import diagnostics as d
from gonio.mcmc.chain.boundary import reflect, wrap
from gonio.mcmc.chain.draws import ROWS, Draws


def test_rows_do_not_depend_on_how_they_are_asked_for():
    a, b = Draws(5, 3, 4, 2), Draws(5, 3, 4, 2)
    whole = a.rows(ROWS - 10, 2 * ROWS)
    parts = [b.rows(t, 1) for t in range(ROWS - 10, 3 * ROWS - 10)]
    assert np.array_equal(whole[0], np.concatenate([p[0] for p in parts]))
    assert np.array_equal(whole[1], np.concatenate([p[1] for p in parts]))


def test_chains_and_seeds_differ_and_numbers_are_uniform_and_normal():
    u, z = Draws(1, 40, 3, 3).rows(0, ROWS)
    v, _ = Draws(2, 40, 3, 3).rows(0, ROWS)
    assert not np.array_equal(u, v)
    assert abs(np.corrcoef(u[:, 0, 0], u[:, 0, 1])[0, 1]) < 0.2
    assert stats.kstest(u.ravel(), "uniform").pvalue > 1e-3
    assert stats.kstest(z.ravel(), "norm").pvalue > 1e-3


@pytest.mark.parametrize("kappa", [1e-3, 1.0, 50.0, 1e3, 1e6])
def test_vmf_draws_follow_the_density(kappa):
    """1 - cos t against its cumulative, which is exact in closed form; and the density integrates to 1."""
    rng = np.random.default_rng(3)
    mu = np.broadcast_to(np.array([0.48, -0.6, 0.64]), (20_000, 3))
    w = sample_vmf(mu, kappa, rng.random(20_000), rng.random(20_000))
    v = 0.5 * np.sum((w - mu) ** 2, 1)  # 1 - cos t without cancellation
    assert stats.kstest(v, lambda x: np.expm1(-kappa * x) / np.expm1(-2 * kappa)).pvalue > 1e-3
    assert stats.kstest(v, lambda x: np.expm1(-1.2 * kappa * x) / np.expm1(-2.4 * kappa)).pvalue < (
        1e-6 if kappa > 0.5 else 1
    )
    scale = min(2.0, 40 / kappa)
    total = quad(lambda x: 2 * np.pi * np.exp(log_vmf(1 - x, kappa)), 0, scale)[0]
    assert abs(total - 1) < 1e-6
    assert np.allclose(log_vmf_between(mu[:50], w[:50], kappa), log_vmf(1 - v[:50], kappa), atol=1e-8 + 1e-9 * kappa)


def test_boundaries():
    x = np.array([-2.3, -0.2, 0.0, 0.4, 1.0, 1.3, 2.6])
    assert np.allclose(reflect(x), [0.3, 0.2, 0.0, 0.4, 1.0, 0.7, 0.6])
    assert np.allclose(wrap(x), [0.7, 0.8, 0.0, 0.4, 0.0, 0.3, 0.6])


def ar1(shift=0.0):
    """The check series: AR(1), phi = 0.7, 4 chains of 1000."""
    e = np.random.default_rng(20240601).standard_normal((4, 1000))
    x = np.empty_like(e)
    x[:, 0] = e[:, 0] / np.sqrt(1 - 0.7**2)
    for t in range(1, 1000):
        x[:, t] = 0.7 * x[:, t - 1] + e[:, t]
    x[0] += shift
    return x


def test_diagnostics_reproduce_the_check_values():
    x = ar1()
    assert np.allclose(
        [d.rhat(x), d.ess_bulk(x), d.ess_tail(x), d.mcse_mean(x)], [1.0032131, 756.732, 1256.642, 0.0513305], rtol=1e-6
    )
    y = ar1(1.0)
    assert np.allclose([d.rhat(y), d.ess_bulk(y)], [1.0674358, 50.1547], rtol=1e-6)


def test_diagnostics_equal_arviz():
    az = pytest.importorskip("arviz", reason="arviz is in the study extra")
    for seed in range(60):
        rng = np.random.default_rng(seed)
        x = rng.standard_normal((rng.integers(2, 5), rng.integers(20, 300)))
        phi = rng.uniform(-0.9, 0.99)
        for t in range(1, x.shape[1]):
            x[:, t] += phi * x[:, t - 1]
        ours = [d.rhat(x), d.ess_bulk(x), d.ess_tail(x), d.ess_mean(x), d.mcse_mean(x)]
        theirs = [az.rhat(x), az.ess(x), az.ess(x, method="tail"), az.ess(x, method="mean"), az.mcse(x)]
        assert np.allclose(ours, theirs, rtol=1e-6, equal_nan=True)
        log_w = 2 * rng.standard_normal(2000)
        assert np.isclose(d.pareto_k(log_w), az.psislw(log_w)[1], rtol=1e-6)


def test_weights():
    assert np.isclose(d.importance_ess(np.zeros(10)), 10)
    assert np.isclose(d.importance_ess(np.array([0.0, -np.inf])), 1)
    assert np.isclose(d.weight_maximum(np.log(np.array([1.0, 3.0]))), 1.5)


def test_autocorrelation_time_is_not_trusted_on_a_short_chain():
    x = ar1()
    tau, trusted = d.autocorrelation_time(x)
    assert 4 < tau < 8 and trusted
    assert not d.autocorrelation_time(x[:, :100])[1]
