"""Warps of [0, 1]: values by hand, slopes against finite differences, round trips to the faces."""

import numpy as np
import pytest

from gonio.flow.quadratic import SMALLEST, Quadratic
from gonio.flow.rational import Rational

WARPS = [Quadratic, Rational]


def raw(warp, n=2000, bins=32, seed=1, scale=2.0):
    return (scale * np.random.default_rng(seed).standard_normal((warp.parameters(bins), n))).astype(np.float32)


def points(n, seed=2):
    x = np.random.default_rng(seed).random(n)
    x[: n // 10], x[n // 10 : n // 5] = 0.0, 1.0
    return x


def test_quadratic_by_hand():
    # two bins of equal width; heights 1 : 3 : 1 before normalisation, so areas 1/2 and 1/2, heights 0.5, 1.5, 0.5
    raw = np.log(np.array([[1.0, 1.0, 1.0, 3.0, 1.0]])).T
    w = Quadratic(raw, 2, False)
    x = np.array([0.25])
    z, log_slope = w.forward(x)
    floor = 1 - SMALLEST
    assert z[0] == pytest.approx(floor * (0.25 * 0.5 + 0.5 * 0.25 * 0.5) + SMALLEST * 0.25, abs=1e-12)
    assert np.exp(log_slope[0]) == pytest.approx(floor * 1.0 + SMALLEST, abs=1e-12)


def test_rational_of_equal_bins_and_slopes_is_the_identity():
    one = np.log(np.expm1(1 - SMALLEST))  # softplus^-1
    w = Rational(np.array([[0.0] * 8 + [one] * 5]).T, 4, False)
    z, log_slope = w.forward(np.array([0.3]))
    assert z[0] == pytest.approx(0.3, abs=1e-12)
    assert log_slope[0] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("warp", WARPS)
@pytest.mark.parametrize("tied", [False, True])
def test_round_trip_and_faces(warp, tied):
    w, x = warp(raw(warp), 32, tied), points(2000)
    z, there = w.forward(x)
    back, again = w.inverse(z)
    assert ((z >= 0) & (z <= 1) & (back >= 0) & (back <= 1)).all()
    assert np.abs(back - x).max() < 1e-9
    assert np.abs(again - there).max() < 1e-6
    faces = w.forward(np.where(x < 0.5, 0.0, 1.0))[0]
    assert np.abs(faces - np.round(faces)).max() < 1e-12


@pytest.mark.parametrize("warp", WARPS)
def test_slope_is_the_derivative(warp):
    w = warp(raw(warp, scale=1.0), 32, False)
    x = 0.01 + 0.98 * points(2000) * 0.999
    step = 1e-7
    numeric = (w.forward(x + step)[0] - w.forward(x - step)[0]) / (2 * step)
    error = np.abs(np.log(numeric) - w.forward(x)[1])
    assert np.quantile(error, 0.99) < 1e-4  # a knot between x - step and x + step is the rest


@pytest.mark.parametrize("tied", [False, True])
def test_quadratic_gradient_is_that_of_differences(tied):
    n, bins = 200, 6
    a, x = raw(Quadratic, n, bins, scale=1.0).astype(float), 0.001 + 0.998 * np.random.default_rng(3).random(n)
    by_z, by_log = np.random.default_rng(4).standard_normal((2, n))

    def loss(a, x):
        z, log_slope = Quadratic(a, bins, tied).forward(x)
        return by_z * z + by_log * log_slope

    step = 1e-6
    by_x, by_raw = Quadratic(a, bins, tied).gradient(x, by_z, by_log)
    numeric = (loss(a, x + step) - loss(a, x - step)) / (2 * step)
    assert np.quantile(np.abs(by_x - numeric) / (1 + np.abs(numeric)), 0.98) < 1e-5  # knots within the step: the rest
    for j in range(len(a)):
        moved = np.zeros_like(a)
        moved[j] = step
        numeric = (loss(a + moved, x) - loss(a - moved, x)) / (2 * step)
        assert np.quantile(np.abs(by_raw[j] - numeric), 0.98) < 1e-6
    assert np.abs(by_raw).max() > 0.1  # negative control: there was something to find


def test_the_textbook_root_fails_where_ours_does_not():
    """Negative control: (-b + sqrt(b^2 + 4ac)) / 2a cancels where a bin's density is nearly even."""
    v0, v1, z = 1.0, 1.0 + 1e-12, 0.37
    a, b = 0.5 * (v1 - v0), v0
    cancelled = (-b + np.sqrt(b * b + 4 * a * z)) / (2 * a)
    ours = 2 * z / (b + np.sqrt(b * b + 4 * a * z))
    assert abs(ours - 0.37) < 1e-11
    assert abs(cancelled - 0.37) > 1e-6


def test_float32_knots_do_not_survive_a_round_trip():
    """Negative control of the float64 rule (METHOD 8)."""
    w, x = Quadratic(raw(Quadratic), 32, False), points(2000)
    for name in ("w", "v", "x", "z"):
        setattr(w, name, getattr(w, name).astype(np.float32))
    back = w.inverse(w.forward(x.astype(np.float32))[0].astype(np.float32))[0]
    assert np.abs(back - x).max() > 1e-7


@pytest.mark.parametrize("warp", WARPS)
def test_a_tied_warp_closes_its_density(warp):
    w = warp(raw(warp), 32, True)
    ends = [w.forward(np.full(2000, x))[1] for x in (0.0, 1.0)]
    assert np.abs(ends[0] - ends[1]).max() < 1e-6  # what rounding leaves of the last bin's end
