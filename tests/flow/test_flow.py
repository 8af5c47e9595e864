"""The flow: one density both ways, draws that follow it, conditionals, masks, and torch's twin of it."""

import numpy as np
import pytest
from scipy.stats import chi2

from gonio.flow import lattice
from gonio.flow.cubes import make_cube
from gonio.flow.density import FlowDensity
from gonio.flow.flow import Flow, FlowError, Shape

SHAPES = {
    "thesis": Shape(hidden=32),
    "leading": Shape(leading=(2,), encoding="one_blob", hidden=32, bins=16),
    "rational": Shape(warp="rational", encoding="harmonics", hidden=32, bins=16),
    "four": Shape(dimensions=4, leading=(3, 2), periodic=(1, 3), encoding="one_blob", hidden=32, bins=16),
    "code": Shape(leading=(2,), code=3, hidden=32, bins=16),
}


def wild(shape, seed=5, scale=0.25):
    """A flow far from the identity; a rational one's slopes run away sooner."""
    scale *= 0.4 if shape.warp == "rational" else 1
    rng = np.random.default_rng(seed)
    f = Flow.fresh(shape, rng)
    w = {k: v + scale * rng.standard_normal(v.shape) * (".out." in k) for k, v in f.weights.items()}
    return Flow(shape, w, rng.standard_normal(shape.code))


@pytest.mark.parametrize("name", SHAPES)
def test_round_trip_both_ways(name):
    # as peaked as chrome's (log q up to 6.4 there), or more
    f = wild(SHAPES[name])
    rng = np.random.default_rng(6)
    x = rng.random((20_000, f.shape.dimensions))
    face = rng.random(x.shape) < 0.02
    x[face] = np.round(x[face])
    z, there = f.to_base(x)
    assert there.max() > 5
    back, again = f.from_base(z)
    apart = np.abs(back - x)
    if f.shape.periodic:
        apart = np.minimum(apart, 1 - apart)
    assert apart.max() < 1e-9
    assert np.abs(again - there).max() < 1e-5
    assert ((z >= 0) & (z <= 1) & (back >= 0) & (back <= 1)).all()


@pytest.mark.parametrize("name", ["thesis", "leading"])
def test_round_trip_where_float32_rounds_either_way(name, monkeypatch):
    f = wild(SHAPES[name])
    nodes = np.random.default_rng(6).integers(0, lattice.FINENESS, (4000, 3))
    x = (nodes + 0.5) / lattice.FINENESS
    apart = lambda: np.abs(f.from_base(f.to_base(x)[0])[0] - x).max()
    assert apart() < 1e-9
    monkeypatch.setattr(lattice, "NEAR", 0.0)  # negative control: with steps, a neighbour's warp leads back
    assert apart() > 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_draws_follow_the_density(name):
    f = wild(SHAPES[name])
    rng = np.random.default_rng(7)
    n, cells = 40_000, 6
    x, _ = f.from_base(rng.random((n, f.shape.dimensions)))
    even = rng.random((200_000, f.shape.dimensions))
    q = np.exp(f.log_prob(even))
    assert q.mean() == pytest.approx(1, abs=6 * q.std() / np.sqrt(len(q)))
    a, b = 0, f.shape.dimensions - 1
    cell = lambda p: (
        np.minimum((cells * p[:, a]).astype(int), cells - 1) * cells
        + np.minimum((cells * p[:, b]).astype(int), cells - 1)
    )
    due = np.bincount(cell(even), q, cells**2) / q.sum()
    noise = np.bincount(cell(even), q**2, cells**2) / q.sum() ** 2  # the expectation is itself an estimate
    got = np.bincount(cell(x), minlength=cells**2) / n
    statistic = lambda got: float(np.sum((got - due) ** 2 / (due / n + noise)))
    limit = chi2.ppf(1 - 1e-4, cells**2 - 1)
    assert statistic(got) < limit
    wrong, _ = f.from_base(np.sqrt(rng.random((n, f.shape.dimensions))))  # negative control
    assert statistic(np.bincount(cell(wrong), minlength=cells**2) / n) > limit


def test_conditional_is_joint_over_marginal():
    f = wild(SHAPES["leading"])
    rng = np.random.default_rng(8)
    x = rng.random((50, 3))
    for row in x[:5]:
        many = rng.random((60_000, 3))
        many[:, 2] = row[2]
        marginal = np.exp(f.log_prob(many)).mean()
        joint = np.exp(f.log_prob(row[None])[0])
        assert np.exp(f.conditional(row[None])[0]) == pytest.approx(joint / marginal, rel=0.05)
    drawn, log_q = f.conditional_draw(x)
    assert np.array_equal(drawn[:, 2], x[:, 2])
    assert f.conditional(drawn) == pytest.approx(log_q, abs=1e-5)


@pytest.mark.parametrize("name", ["thesis", "leading", "code"])
def test_one_point_is_as_many(name):
    f = wild(SHAPES[name], scale=0.05)
    x = np.random.default_rng(9).random((300, 3))
    one = np.concatenate([f.log_prob(x[k : k + 1]) for k in range(len(x))])
    assert one == pytest.approx(f.log_prob(x), abs=2e-4)


def test_masks_move_every_coordinate():
    for shape in (*SHAPES.values(), Shape(couplings=3), Shape(dimensions=4)):
        assert {moved for moved, _ in shape.masks} == set(range(shape.dimensions))


def test_untrained_is_even():
    f = Flow.fresh(Shape(), np.random.default_rng(0))
    x = np.random.default_rng(1).random((100, 3))
    assert f.log_prob(x) == pytest.approx(0, abs=1e-6)


def test_weights_of_another_shape_are_refused():
    f = wild(SHAPES["thesis"])
    with pytest.raises(FlowError, match="do not fit"):
        Flow(Shape(hidden=16), f.weights)
    with pytest.raises(FlowError, match="not all finite"):
        Flow(f.shape, {**f.weights, "0.in.b": np.full(32, np.nan)})
    with pytest.raises(FlowError, match="another version"):
        Flow.from_arrays({"shape.bins": np.array(3)})


@pytest.mark.slow
@pytest.mark.parametrize("coordinates", ["half", "vndf", "raw"])
@pytest.mark.parametrize("anisotropic", [False, True])
def test_density_of_directions(coordinates, anisotropic):
    """It integrates to one over both hemispheres, and what is drawn has the density that is said."""
    cube = make_cube(coordinates, 0.3, anisotropic)
    f = Flow.fresh(
        Shape(dimensions=cube.dimensions, leading=cube.leading, periodic=cube.periodic, hidden=8, bins=8),
        np.random.default_rng(2),
    )
    density = FlowDensity(f, cube)
    rng = np.random.default_rng(3)
    wi, wo = density.sample(rng.random((5, 60_000)))
    up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    # E_q[g / q] = the integral of g: of a smooth g over both hemispheres, (pi)^2 for g = cos cos
    q = np.exp(density.log_prob(wi[up], wo[up]))
    estimate = np.sum(wi[up, 2] * wo[up, 2] / q) / len(wi)
    spread = np.std(np.where(up, 0, 0)[up] + wi[up, 2] * wo[up, 2] / q) / np.sqrt(len(wi))
    assert estimate == pytest.approx(np.pi**2, abs=6 * spread)


def test_conditional_of_directions():
    cube = make_cube("half", 0.1)
    f = wild(Shape(leading=cube.leading, encoding="one_blob", hidden=16, bins=8), scale=0.1)
    density = FlowDensity(f, cube)
    rng = np.random.default_rng(4)
    from gonio.geometry import from_angles

    wi = np.tile(from_angles(0.9, 1.3), (60_000, 1))
    wo, log_p = density.sample_conditional(wi, rng.random((60_000, 2)))
    assert density.conditional(wi, wo) == pytest.approx(log_p, abs=1e-4)
    values = wo[:, 2] / np.exp(log_p)
    assert values.mean() == pytest.approx(np.pi, abs=6 * values.std() / np.sqrt(len(wi)))
