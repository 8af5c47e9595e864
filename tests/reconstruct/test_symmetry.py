"""A sample that did not lie as the rig believed: found, corrected, and what is left counted in the estimate."""

import numpy as np
import pytest
from truths import BRUSHED, GLOSSY, energy_error, pairs, samples

from gonio.geometry import from_angles
from gonio.reconstruct import Samples, reconstruct
from gonio.reconstruct.splines import symmetry
from gonio.reconstruct.splines.auto import Problem, peak_width
from gonio.reconstruct.splines.isotropic import Isotropic
from gonio.reconstruct.splines.symmetry import Alignment

NONE = Alignment()


def read(truth, off: Alignment, n=1500, seed=0) -> Samples:
    """What a rig reads that believes the sample in its place while it is `off`."""
    wi, wo = pairs(truth, n, seed)
    f = truth.eval(*off.turned(wi, wo))
    sigma = np.hypot(0.005 * f, 3e-5)
    return Samples.of(wi, wo, f + sigma * np.random.default_rng(seed + 1).standard_normal(f.shape), sigma)


def asked(s: Samples) -> symmetry.Symmetry:
    p = Problem.of(s, Isotropic(), np.random.default_rng(0))
    return symmetry.ask(p, peak_width(p), np.random.default_rng(0))


@pytest.mark.parametrize("off", [Alignment(0, 0, 4.0), Alignment(1.0, 0, 0), Alignment(0.4, -0.6, 1.5)])
def test_tilt_and_azimuth_are_found(off):
    found = asked(read(GLOSSY, off))
    assert found.corrected and found.ratio < symmetry.GAIN
    assert np.abs(found.alignment.angles - off.angles).max() < 0.25
    assert found.left < 0.02


def test_a_sample_in_its_place_is_left_alone():
    found = asked(read(GLOSSY, NONE))
    assert not found.corrected and found.left < 0.02


def test_corrected_it_is_nearly_as_good_as_in_its_place():
    turned = reconstruct(read(GLOSSY, Alignment(0, 0, 4.0)))
    assert energy_error(turned, GLOSSY) < 0.01  # 0.003 in its place, above 0.05 uncorrected
    assert turned.notes["mirror_asymmetry"] > 0.1
    assert abs(turned.alignment.azimuth - 4) < 0.25


def test_uncorrected_it_would_be_wrong_and_the_estimate_says_so(monkeypatch):
    """Negative control, and the other half: a contradiction that no angle explains is in the estimate."""
    monkeypatch.setattr(symmetry, "GAIN", 0.0)
    monkeypatch.setattr(symmetry, "SURELY", 0.0)
    got = reconstruct(read(GLOSSY, Alignment(0, 0, 4.0)))
    error = energy_error(got, GLOSSY)
    assert error > 0.05
    assert got.energy_error_estimate > 0.7 * error


def test_thousands_of_readings_at_one_incidence():
    """Splines zigzag between the folded sides and the table smooths that away: the estimate is the table's."""
    rng = np.random.default_rng(3)
    wo = from_angles(np.arcsin(np.sqrt(0.95 * rng.random(8000))), 2 * np.pi * rng.random(8000))
    wi = np.broadcast_to(from_angles(np.radians(45), 0.0), wo.shape)
    off = Alignment(0, 0, 4.0)
    f = GLOSSY.eval(*off.turned(wi, wo))
    got = reconstruct(Samples.of(wi[::2], wo[::2], f[::2], 0.002 * f[::2]))
    said = got.eval(*got.alignment.turned(wi[1::2], wo[1::2]))
    cos = wo[1::2, 2:]
    assert (np.abs(said - f[1::2]) * cos).sum() / (f[1::2] * cos).sum() < 0.02


def test_a_cosine_is_divided_out_anew_where_that_explains_the_data():
    off = Alignment(3.0, 0, 0)
    s = read(GLOSSY, off, 3000)
    wi, _ = off.turned(s.wi, s.wo)
    scale = wi[:, 2:] / s.wi[:, 2:]  # the signal falls with the true cosine, the rig divides by the believed one
    keep = (s.wi[:, 2] > 0.1) & (wi[:, 2] > 0.1)
    found = asked(Samples.of(s.wi[keep], s.wo[keep], (s.f * scale)[keep], s.sigma[keep]))
    assert found.alignment.cosine and abs(found.alignment.tilt_x - 3) < 0.3


def test_a_grain_that_was_called_isotropic_shows():
    found = asked(samples(BRUSHED, 1500))
    assert found.turned > 0.2


def test_readings_in_one_plane_say_nothing_of_a_tilt_out_of_it():
    """They cannot contradict each other: no angle is to be found in their noise."""
    rng = np.random.default_rng(1)
    turn, low = rng.uniform(-80, 80, 800), rng.uniform(0, 80, 800)
    wi = from_angles(np.radians(low), np.zeros(800))
    wo = from_angles(np.radians(np.abs(turn)), np.where(turn > 0, 0, np.pi))
    f = GLOSSY.eval(wi, wo) * (1 + 0.02 * rng.standard_normal((800, 1)))
    found = asked(Samples.of(wi, wo, f, 0.02 * f))
    assert not found.corrected or found.ratio < symmetry.SURELY


def test_alignment_is_a_rotation_to_first_order():
    wi, wo = pairs(GLOSSY, 200)
    small = Alignment(0.01, -0.02, 0.03)
    back = Alignment(*(-small.angles))
    a, b = back.turned(*small.turned(wi, wo))
    assert np.abs(a - wi).max() < 1e-6 and np.abs(b - wo).max() < 1e-6
