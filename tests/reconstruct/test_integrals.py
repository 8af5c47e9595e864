"""Albedos of what was drawn: unbiased, with errors that hold, whatever the control is worth."""

import numpy as np
import pytest

from gonio.bench.drive import surrogate
from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.config import Material
from gonio.mcmc import make_sampler
from gonio.mcmc.proposals import DRAWN, INDEPENDENCE
from gonio.mcmc.proposals.pool import Pool
from gonio.reconstruct import Samples, integrals
from gonio.reconstruct.errors import ReconstructionError
from gonio.reconstruct.integrals import BANDS, Draws, albedo

BRDF = Mixture([Lambert([0.3, 0.05]), Ggx(0.15, None, [0.4, 0.04])])


def measured(seed, count=250):
    material = Material.model_validate({"name": "x", "channels": 2, "seed": seed})
    sampler = make_sampler(material, None, surrogate, (count,))
    rng = np.random.default_rng(seed)
    wi, wo, f, sigma = [], [], [], []
    while sampler.next_id < count:
        batch = sampler.ask()
        truth = BRDF.eval(batch.wi, batch.wo)
        s = 0.005 * truth + 1e-4
        readings = truth + s * rng.standard_normal(truth.shape)
        sampler.tell(batch.ids, readings, s)
        for column, new in zip((wi, wo, f, sigma), (batch.wi, batch.wo, readings, s)):
            column.append(new)
    steps = sampler.take_steps()
    drawn = np.isin(steps.kind, (DRAWN, INDEPENDENCE)) & (steps.id >= 0)
    block = np.where(steps.step >= 0, steps.step + 1, steps.chain)
    samples = Samples.of(*(np.concatenate(c) for c in (wi, wo, f, sigma)))
    draws = Draws(block[drawn], steps.id[drawn], steps.wi[drawn], steps.wo[drawn], steps.log_q[drawn])
    return samples, draws


@pytest.fixture(scope="module")
def runs():
    return [measured(seed) for seed in range(8)]


@pytest.fixture(scope="module")
def exact():
    rng = np.random.default_rng(9)
    return np.mean([integrals._by(Pool(0.05), BRDF.eval, 2**16, rng) for _ in range(4)], axis=0)


@pytest.fixture(autouse=True)
def a_quick_control(monkeypatch):
    monkeypatch.setattr(integrals, "CONTROL", 2**13)  # of fewer, four scrambles do not tell the error of their mean


def deviations(runs, exact, change=lambda d: d):
    found = [albedo(s, change(d)) for s, d in runs]
    return np.array([(a.value - exact[:BANDS]) / a.error for a in found]), found


def white(runs, exact, change=lambda d: d):
    found = [albedo(s, change(d)) for s, d in runs]
    return np.array([(a.white[0] - exact[BANDS]) / a.white[1] for a in found])


def test_unbiased_and_the_errors_hold(runs, exact):
    z, found = deviations(runs, exact)
    assert 0.6 < np.sqrt((z**2).mean()) < 1.7
    assert np.abs(white(runs, exact).mean(0)).max() < 4 / np.sqrt(len(runs))
    errors = np.array([a.error / a.value for a in found])
    assert np.median(errors) < 0.04
    assert np.abs(white(runs, exact)).max() < 4.5


def test_negative_control_a_density_that_is_not_the_draws_own(runs, exact, monkeypatch):
    """Where it matters most: without a reconstruction to lean on."""
    monkeypatch.setattr(integrals, "_control", lambda samples, anisotropic: None)
    right = white(runs, exact)
    assert np.sqrt((right**2).mean()) < 2
    wrong = white(runs, exact, lambda d: Draws(d.block, d.row, d.wi, d.wo, d.log_q - 0.5))
    assert np.sqrt((wrong**2).mean()) > 3


def test_the_control_is_worth_its_while(runs, exact, monkeypatch):
    _, with_it = deviations(runs, exact)
    monkeypatch.setattr(integrals, "_control", lambda samples, anisotropic: None)
    _, without = deviations(runs, exact)
    ratio = [np.median(a.white[1] / b.white[1]) for a, b in zip(with_it, without)]
    assert np.median(ratio) < 0.5


def test_a_control_that_is_wrong_costs_width_and_nothing_else(runs, exact, monkeypatch):
    usual = integrals._control

    class TwiceTooBright:
        def __init__(self, control):
            self.coordinates, self.t0, self.held_out = control.coordinates, control.t0, control.held_out
            self.eval = lambda wi, wo: 2 * control.eval(wi, wo)

    monkeypatch.setattr(integrals, "_control", lambda s, a: TwiceTooBright(usual(s, a)))
    assert np.sqrt((white(runs, exact) ** 2).mean()) < 2


def test_too_few_draws_make_no_albedo():
    s, d = measured(0, 60)
    first = d.row < 55
    assert albedo(s, Draws(*(getattr(d, k)[first] for k in ("block", "row", "wi", "wo", "log_q")))) is None


def test_without_a_fit_of_what_came_before(runs, exact, monkeypatch):
    def never(*args, **kw):
        raise ReconstructionError("no")

    monkeypatch.setattr(integrals, "fit", never)
    a = albedo(*runs[0])
    assert np.isfinite(a.value).all() and (a.error > 0).all()


def test_a_band_where_nothing_was_drawn_claims_nothing(runs):
    s, d = runs[0]
    kept = d.wi[:, 2] < np.cos(np.radians(10))
    a = albedo(s, Draws(*(getattr(d, k)[kept] for k in ("block", "row", "wi", "wo", "log_q"))))
    assert np.isinf(a.error[0]).all() and np.isfinite(a.error[-2:]).all()
