"""Training learns, to the bit the same for a seed, and refuses what cannot be learnt from."""

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs torch")

from scipy.stats import beta

from gonio.flow import train as training
from gonio.flow.flow import Flow, FlowError, Shape
from gonio.flow.train import match, train

SMALL = Shape(hidden=16, bins=8, couplings=3)


def fresh(shape=SMALL):
    return Flow.fresh(shape, np.random.default_rng(0))


def points(n=2000, seed=1):
    return np.random.default_rng(seed).beta(2, 6, (n, 3))


def trained(x, w=None, **kw):
    kw = {"steps": 250, "batch": 128, "rate": 5e-3, **kw}
    return train(fresh(kw.pop("shape", SMALL)), x, w, rng=np.random.default_rng(2), **kw)


@pytest.mark.parametrize("warp", ["quadratic", "rational"])
@pytest.mark.parametrize("encoding", ["plain", "one_blob", "harmonics"])
def test_torch_and_numpy_are_one_density(warp, encoding):
    shape = Shape(warp=warp, encoding=encoding, leading=(2,), periodic=(1,), code=3, hidden=16, bins=8)
    rng = np.random.default_rng(3)
    f = fresh(shape)
    f = Flow(shape, {k: v + 0.1 * rng.standard_normal(v.shape) for k, v in f.weights.items()}, rng.standard_normal(3))
    x = rng.random((400, 3))
    p = {k: torch.tensor(v) for k, v in f.weights.items()}
    code = torch.tensor(f.code, dtype=torch.float32).expand(400, -1)
    assert training.log_prob(p, shape, torch.tensor(x), code).numpy() == pytest.approx(f.log_prob(x), abs=1e-3)


def test_learns_a_density():
    held = points(4000, seed=9)
    truth = beta(2, 6).logpdf(held).sum(1).mean()
    done = trained(points(4000))
    assert truth - done.flow.log_prob(held).mean() < 0.1
    assert done.skipped == 0


def test_weights_make_the_density():
    x = np.random.default_rng(4).random((6000, 3))
    w = beta(2, 6).pdf(x).prod(1)
    held = points(4000, seed=9)
    missed = beta(2, 6).logpdf(held).sum(1).mean() - trained(x, w).flow.log_prob(held).mean()
    unweighted = beta(2, 6).logpdf(held).sum(1).mean() - trained(x).flow.log_prob(held).mean()
    assert missed < 0.2 < unweighted  # the second is the negative control


def test_a_seed_gives_the_same_weights_to_the_bit():
    a, b = (trained(points(500), steps=30).flow for _ in range(2))
    assert all(np.array_equal(a.weights[k], b.weights[k]) for k in a.weights)
    c = train(fresh(), points(500), steps=30, batch=128, rate=5e-3, rng=np.random.default_rng(3)).flow
    assert any(not np.array_equal(a.weights[k], c.weights[k]) for k in a.weights)


def test_codes_are_learnt():
    shape = Shape(hidden=16, bins=8, couplings=3, code=2)
    low, high = points(1500), 1 - points(1500, seed=5)
    x, material = np.concatenate([low, high]), np.repeat([0, 1], 1500)
    done = trained(x, shape=shape, material=material, codes=np.array([[0.1, 0], [-0.1, 0]]))
    a, b = (done.flow.at(c) for c in done.codes)
    assert a.log_prob(low).mean() > b.log_prob(low).mean() + 1
    assert b.log_prob(high).mean() > a.log_prob(high).mean() + 1


def test_match_finds_shape_and_constant():
    x = np.random.default_rng(6).random((3000, 3))
    log_g = np.log(7.0) + np.cos(2 * np.pi * x[:, 0]) + np.sin(np.pi * x[:, 1]) * x[:, 2]
    flow, log_c = match(
        fresh(), x, log_g, np.arange(3000) % 8 == 0, steps=300, batch=256, rate=5e-3, rng=np.random.default_rng(0)
    )
    assert log_c == pytest.approx(np.log(np.exp(log_g).mean()), abs=0.1)
    assert np.median(np.abs(flow.log_prob(x) + log_c - log_g)) < 0.1
    assert np.median(np.abs(log_g - log_g.mean())) > 0.4  # negative control: the even density is no match


@pytest.mark.parametrize(
    "x, w, said",
    [
        (points(100), np.full(100, np.nan), "not numbers"),
        (points(100), -np.ones(100), "not numbers"),
        (points(100), np.zeros(100), "0 samples"),
        (points(9), None, "9 samples"),
        (np.tile([[0.3, 0.2, 0.1]], (500, 1)), None, "one spot"),
        (np.full((500, 3), np.nan), None, "0 samples"),
    ],
)
def test_bad_samples_are_refused(x, w, said):
    with pytest.raises(FlowError, match=said):
        trained(x, w, steps=3)


def test_a_step_that_is_not_finite_is_left_out(monkeypatch):
    real, calls = training.log_prob, []

    def sometimes(*a):
        calls.append(0)
        out = real(*a)
        return out * np.nan if len(calls) % 3 == 0 else out

    monkeypatch.setattr(training, "log_prob", sometimes)
    done = trained(points(500), steps=9)
    assert done.skipped == 3
    assert all(np.isfinite(v).all() for v in done.flow.weights.values())
