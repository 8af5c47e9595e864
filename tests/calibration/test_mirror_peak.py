"""A mirror's peak is found where it is, as surely as it says; what is not one peak is named."""

import numpy as np
import pytest

from calibration.geometry.peak import NoPeak, find_peak, spiral

WIDTH = np.radians(0.5)


def looking(centres, rng=None, noise=0.003, top=1000.0):
    """A detector that sees Gaussian spots at `centres` (rad) and tells signal and sigma."""
    seen = []

    def look(w):
        seen.append(w)
        signal = sum(top * np.exp(-np.sum((w - c) ** 2) / (2 * WIDTH**2)) for c in np.atleast_2d(centres))
        sigma = np.hypot(1e-3, noise * signal)
        return w, signal + (rng.normal() * sigma if rng else 0.0), sigma

    return look, seen


@pytest.mark.parametrize("centre_deg", [(0.0, 0.0), (0.4, -0.3), (3.0, 1.5), (-4.2, 0.7)])
def test_found_wherever_it_is(centre_deg):
    centre = np.radians(centre_deg)
    look, _ = looking(centre)
    peak = find_peak(look, np.radians(6))
    assert np.abs(peak.centre - centre).max() < 1e-9 and peak.width == pytest.approx(WIDTH, rel=1e-6)
    assert peak.signal == pytest.approx(1000, rel=1e-6)


def test_as_surely_as_it_says():
    centre = np.radians([0.3, -0.2])
    z = []
    for seed in range(200):
        look, _ = looking(centre, np.random.default_rng(seed), noise=0.02)
        peak = find_peak(look, np.radians(3))
        z.append((peak.centre - centre) / np.sqrt(np.diag(peak.covariance)))
    assert 0.85 < np.std(z) < 1.15


def test_the_nearest_way_costs_nine_looks():
    look, seen = looking(np.radians([0.05, 0.02]))
    find_peak(look, np.radians(6))
    assert len(seen) <= 19  # one, a grid of nine, and one to its middle


@pytest.mark.parametrize(
    ("look", "what"),
    [
        (lambda w: (w, 0.0, 1e-3), "nothing but darkness: is the lamp on"),
        (lambda w: (w, 0.02, 1e-3), "is the mirror level and clean"),
        (lambda w: (w, 1000.0 * (1 + w[0]), 1.0), "no top"),
    ],
)
def test_what_is_no_peak_is_named(look, what):
    with pytest.raises(NoPeak, match=what):
        find_peak(look, np.radians(4))


def test_a_cracked_mirror_has_two():
    look, _ = looking(np.radians([[0.0, 0.0], [2.6, 0.4]]))
    with pytest.raises(NoPeak, match=r"two peaks, 2\.5 degrees apart"):
        find_peak(look, np.radians(4), alone=True)
    assert np.hypot(*find_peak(look, np.radians(4)).centre) < np.radians(0.01)  # who does not ask is not told


def test_the_spiral_leaves_no_gap():
    points = np.degrees(spiral(np.radians(5), np.radians(1)))
    grid = np.stack(np.meshgrid(np.linspace(-3, 3, 61), np.linspace(-3, 3, 61)), -1).reshape(-1, 2)
    inside = grid[np.hypot(*grid.T) < 4]
    assert np.linalg.norm(inside[:, None] - points, axis=-1).min(1).max() < 1.1
