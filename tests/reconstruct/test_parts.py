"""The parts of the default reconstruction, each against what it must be."""

import numpy as np
import pytest
from scipy.stats import chi2
from truths import BRUSHED, GLOSSY, pairs, samples

from gonio.geometry import from_angles, reflect, to_half_diff
from gonio.reconstruct import reconstruct
from gonio.reconstruct.splines.grain import Grain
from gonio.reconstruct.splines.isotropic import Isotropic
from gonio.reconstruct.splines.patches import (
    Patches,
    amplitude,
    correlation,
    left_out_with_variance,
    relative_variance,
)
from gonio.reconstruct.splines.posterior import Posterior, width
from gonio.reconstruct.splines.residual import LogRatio
from gonio.reconstruct.splines.robust_base import Angles, RobustBase, dictionary
from gonio.reconstruct.tables.half_grid import HalfGrid
from gonio.reconstruct.tables.lookup import Lookup, nodes

RNG = np.random.default_rng(11)


@pytest.fixture(autouse=True)
def _same_numbers_in_any_order(monkeypatch):
    """Each test draws its own numbers, whichever ran before it in the same worker."""
    monkeypatch.setitem(globals(), "RNG", np.random.default_rng(11))


def test_angles_are_those_of_the_geometry():
    wi, wo = pairs(GLOSSY, 2000)
    a = Angles.of(wi, wo)
    theta_h, _, theta_d, phi_d = to_half_diff(wi, wo)
    assert np.allclose(a.theta_h, theta_h, atol=1e-12) and np.allclose(a.theta_d, theta_d, atol=1e-12)
    clear = np.minimum(theta_h, theta_d) > 1e-3
    assert np.allclose(a.phi_d[clear], np.abs(phi_d)[clear], atol=1e-9)


def test_base_by_table_is_the_dictionary():
    weights = RNG.random((52, 3))
    a = Angles.of(*pairs(GLOSSY, 2000))
    assert np.allclose(RobustBase(weights)(a), dictionary(a) @ weights, rtol=1e-5)


def test_log_ratio_round_trip():
    g, b = RNG.random((200, 3)) * 10.0 ** RNG.uniform(-4, 4, (200, 1)), RNG.random((200, 3))
    ratio = LogRatio(np.array([1e-3, 1e-4, 1e-5]))
    assert np.allclose(ratio.inverse(ratio.forward(g, b), b), g, rtol=1e-9, atol=1e-9)
    step = 1e-6
    y = ratio.forward(g, b)
    slope = (ratio.inverse(y + step, b) - ratio.inverse(y - step, b)) / (2 * step)
    inside = y > -2
    assert np.allclose(slope[inside], ratio.slope(g, b)[inside], rtol=1e-3)


def test_patches_pass_through_exact_data_and_follow_a_slope():
    x = RNG.random((600, 3))
    y = np.stack([x @ [1.0, -2.0, 0.5], np.sin(3 * x[:, 0])], 1)
    p = Patches(x, y, np.zeros(600))
    q = RNG.uniform(0.2, 0.8, (300, 3))
    assert np.abs(p(q)[:, 0] - q @ [1.0, -2.0, 0.5]).max() < 0.03
    assert np.abs(p(q)[:, 1] - np.sin(3 * q[:, 0])).max() < 0.05
    assert np.abs(p(x) - y).max() < 0.02


def test_far_from_all_data_the_base_is_what_is_said_and_nothing_is_known():
    x, y, none = RNG.random((400, 5)), RNG.standard_normal((400, 3)), np.zeros(400)
    far = x[:50] + 40
    assert np.abs(Patches(x, y, none)(far)).max() < 1e-6
    assert relative_variance(x, y, none, far).min() > 0.999
    assert relative_variance(x, y, none, x[:50]).max() < 0.01


def test_the_correlation_is_the_one_it_is_called():
    d = np.linspace(0, 9, 200)
    assert np.allclose(correlation(d**2), np.exp(-((d / 2.0) ** 1.5)), rtol=1e-12)


def test_patches_average_noise():
    x = RNG.random((2000, 3))
    noise = 0.3 * RNG.standard_normal((2000, 1))
    told, untold = (Patches(x, noise, np.full(2000, v)) for v in (0.09, 0.0))
    q = RNG.uniform(0.2, 0.8, (500, 3))
    assert told(q).std() < 0.5 * untold(q).std()


def test_left_out_is_what_is_said_without_the_sample():
    """Against the textbook: the sample's row and column struck out, the system solved anew."""
    x = 3 * RNG.random((35, 3))
    y = np.cos(2 * x[:, :1]) + x[:, 1:2]
    noise = RNG.uniform(0, 0.01, 35)
    said, relative = left_out_with_variance(x, y, noise, np.arange(35), neighbours=35)
    square = ((x[:, None] - x[None]) ** 2).sum(-1)
    covariance = np.exp(-((np.sqrt(square) / 2.0) ** 1.5))
    system = covariance + np.diag(1e-3 + noise / amplitude(y, noise))
    for k in (0, 17, 34):
        rest = np.arange(35) != k
        weights = np.linalg.solve(system[rest][:, rest], covariance[rest, k])
        assert np.allclose(weights @ y[rest], said[k], atol=1e-8)
        assert np.isclose(1 - weights @ covariance[rest, k], relative[k], atol=1e-3 + 1e-9)


def test_intervals_hold_of_what_the_process_is():
    """Draws of the very process: as many truths lie inside as the level says; half the intervals hold fewer."""
    rng = np.random.default_rng(5)
    x = 12 * rng.random((900, 3))
    square = ((x[:, None] - x[None]) ** 2).sum(-1)
    root = np.linalg.cholesky(np.exp(-((np.sqrt(square) / 2.0) ** 1.5)) + 1e-9 * np.eye(900))
    y = 0.3 * root @ rng.standard_normal((900, 3))
    known, hidden, none = np.arange(500), np.arange(500, 900), np.zeros(500)
    said, relative = left_out_with_variance(x[known], y[known], none, known)
    p = Posterior.of(x[known], y[known], none, known, said, relative, np.ones(500))
    gap = np.abs(Patches(x[known], y[known], none)(x[hidden]) - y[hidden])
    sd = p.sd(x[hidden])
    for level in (0.68, 0.9, 0.95, 0.99):
        inside = (gap <= width(p.widths / p.widths[0], level) * sd).mean()
        assert abs(inside - level) < 0.06, level
    assert (gap <= 0.5 * sd).mean() < 0.5


def test_lookup_follows_a_cubic_and_wraps():
    at = nodes(20, False)
    around = nodes(32, True)
    values = (at**3)[:, None, None] + np.sin(2 * np.pi * around)[None, :, None]
    table = Lookup(values, (False, True), (8, 8))
    t = RNG.random((1000, 2))
    want = t[:, 0] ** 3 + np.sin(2 * np.pi * t[:, 1])
    assert np.abs(table(t)[:, 0] - want).max() < 2e-3
    assert np.allclose(table(np.array([[0.5, 0.0]])), table(np.array([[0.5, 1.0]])), atol=1e-6)


@pytest.mark.parametrize("frame", [Isotropic(), Grain(0.4, 1.7)])
def test_nodes_of_a_chart_are_where_it_says(frame):
    chart = frame.chart(0.1)
    wi, wo = pairs(BRUSHED, 500)
    a = frame.angles(wi, wo)
    t = chart(a)
    assert ((t >= 0) & (t <= 1)).all()
    n = tuple(5 for _ in chart.periodic)
    got, lower = chart.nodes(n)
    mesh = np.meshgrid(*(nodes(k, wraps) for k, wraps in zip(n, chart.periodic)), indexing="ij")
    want = np.stack([m.ravel() for m in mesh], 1)
    assert np.allclose(chart(got), want, atol=1e-3)
    assert np.allclose(np.minimum(got.cos_i, got.cos_o)[lower > 1e-6], lower[lower > 1e-6])


def test_grain_squeezes_directions_of_its_nodes_back():
    grain = Grain(0.4, 1.7)
    wi, wo = pairs(BRUSHED, 400)
    a = grain.angles(wi, wo)
    s = wi + wo
    c, d = np.cos(0.4), np.sin(0.4)
    slope = np.stack([c * s[:, 0] + d * s[:, 1], c * s[:, 1] - d * s[:, 0]], 1) / s[:, 2:]
    assert np.allclose(np.tan(a.theta_h) * np.cos(a.phi_h), slope[:, 0] / 1.7)
    assert np.allclose(np.tan(a.theta_h) * np.sin(a.phi_h), slope[:, 1] * 1.7)


@pytest.mark.parametrize("truth, azimuths", [(GLOSSY, 1), (BRUSHED, 4)])
@pytest.mark.parametrize("theta_i", [0.3, 1.3])
def test_half_grid_draws_what_its_pdf_says(truth, azimuths, theta_i):
    grid = HalfGrid.of(truth.eval, 0.05, azimuths)
    n = 40_000
    wi = np.broadcast_to(from_angles(theta_i, 0.7), (n, 3))
    wo, pdf = grid.sample(wi, np.random.default_rng(3).random((n, 2)))
    assert np.allclose(np.linalg.norm(wo, axis=1), 1)
    assert np.allclose(pdf, grid.pdf(wi, wo))
    assert _chi_square(grid, wi, wo, lambda a, b: grid.pdf(a, b)) > 1e-4
    # control: a density 3 % off in one half of the sphere of half vectors is seen
    skewed = lambda a, b: grid.pdf(a, b) * (1 + 0.1 * np.sign(np.cross(a, b)[:, 2]))
    assert _chi_square(grid, wi, wo, skewed) < 1e-4


def test_half_grid_values():
    """Drawn once by this code and looked at; a change of the map from u to wo shows here."""
    grid = HalfGrid.of(GLOSSY.eval, 0.05)
    wi = np.broadcast_to(from_angles(0.6, 0.2), (3, 3))
    wo, pdf = grid.sample(wi, np.array([[0.05, 0.5], [0.4, 0.25], [0.9, 0.75]]))
    assert np.all(wo[:, 2] > 0) and np.all(pdf > 0)
    total = _integral(lambda a, b: grid.pdf(a, b), grid, wi[:1])
    assert 0.97 < total <= 1.001


def _cells(grid, wi, wo, count=(12, 12)):
    h = wi + wo
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    u = np.arcsinh(np.arctan2(np.hypot(h[:, 0], h[:, 1]), h[:, 2]) / grid.t0) / grid._length
    v = np.mod(np.arctan2(h[:, 1], h[:, 0]) / (2 * np.pi), 1)
    return (np.minimum(u * count[0], count[0] - 1).astype(int)) * count[1] + np.minimum(
        v * count[1], count[1] - 1
    ).astype(int)


def _quadrature(grid, wi, fine=(480, 480)):
    u, v = (q.ravel() for q in np.meshgrid(*((np.arange(k) + 0.5) / k for k in fine), indexing="ij"))
    h = grid._half_vectors(u, v, 0 * v)
    wi = np.broadcast_to(wi[0], h.shape)
    wo = reflect(wi, h)
    dot = np.einsum("ni,ni->n", wi, h)
    up = (wo[:, 2] > 0) & (dot > 0)
    return wi[up], wo[up], (grid._jacobian(u) * 4 * dot)[up] / (fine[0] * fine[1])


def _integral(pdf, grid, wi):
    a, b, area = _quadrature(grid, wi)
    return float((pdf(a, b) * area).sum())


def _chi_square(grid, wi, wo, pdf) -> float:
    """P value of the draws above the horizon against pdf, in bins of the warped half-vector square."""
    a, b, area = _quadrature(grid, wi)
    wanted = np.bincount(_cells(grid, a, b), pdf(a, b) * area, 144) * len(wo)
    up = wo[:, 2] > 0
    seen = np.bincount(_cells(grid, wi[up], wo[up]), minlength=144)
    enough = wanted > 20
    wanted, seen = np.append(wanted[enough], wanted[~enough].sum()), np.append(seen[enough], seen[~enough].sum())
    keep = wanted > 5
    return float(chi2.sf((((seen - wanted) ** 2 / wanted)[keep]).sum(), keep.sum() - 1))


def test_table_says_what_the_splines_say():
    """One-off tabulation: its own error, and a coarser one as the control that the measure sees it."""
    from gonio.reconstruct.splines.auto import Problem

    s = samples(GLOSSY, 1500)
    p = Problem.of(s, Isotropic(), np.random.default_rng(0))
    stretch = p.frame.stretch(0.15)
    splines = Patches(stretch(p.angles), p.y, p.variance)
    wi, wo = pairs(GLOSSY, 3000, seed=8)
    a = Angles.of(wi, wo)
    want = p.ratio.inverse(splines(stretch(a)), p.base(a))

    def error(coarse):
        chart = p.frame.chart(0.15)
        values = splines(stretch(chart.nodes(coarse)[0])).reshape(*coarse, -1)
        said = p.ratio.inverse(Lookup(values, chart.periodic, chart.refine)(chart(a)), p.base(a))
        return np.abs(said - want).sum() / want.sum()

    assert error(p.frame.chart(0.15).coarse) < 0.003
    assert error((16, 12, 8)) > 0.003


def test_a_density_fit_for_rendering():
    """One sample a pixel: f cos / pdf varies little, and its mean is the albedo."""
    got = reconstruct(samples(GLOSSY, 1000))
    rng = np.random.default_rng(2)
    wi = np.broadcast_to(from_angles(0.7, 0.0), (20_000, 3))
    wo, pdf = got.sample(wi, rng.random((20_000, 2)))
    weight = np.where(pdf > 0, got.eval(wi, wo).mean(1) * wo[:, 2] / np.where(pdf > 0, pdf, 1), 0)
    assert weight.std() < 0.5 * weight.mean()
    uniform = from_angles(np.arccos(rng.random(200_000)), 2 * np.pi * rng.random(200_000))
    albedo = (got.eval(np.broadcast_to(wi[0], uniform.shape), uniform).mean(1) * uniform[:, 2]).mean() * 2 * np.pi
    assert abs(weight.mean() / albedo - 1) < 0.1
