"""The default reconstruction, on truths of known form: right, honest about its error, saved, and never a NaN."""

import numpy as np
import pytest
from truths import BECKMANN, BRUSHED, GLOSSY, OneWay, energy_error, pairs, samples

import gonio
from gonio.load import save_brdf
from gonio.reconstruct import reconstruct
from gonio.reconstruct.running import fit as fit_running


@pytest.fixture(scope="module")
def glossy():
    return reconstruct(samples(GLOSSY, 2000))


def test_energy_error_is_small_and_the_estimate_knows_it(glossy):
    error = energy_error(glossy, GLOSSY)
    assert error < 0.02
    assert 0.5 < glossy.energy_error_estimate / error < 2


def test_control_shuffled_values_are_wrong_and_are_known_to_be():
    s = samples(GLOSSY, 1000)
    shuffled = s.f[np.random.default_rng(3).permutation(len(s))]
    got = fit_running(type(s).of(s.wi, s.wo, shuffled, s.sigma))
    assert energy_error(got, GLOSSY) > 0.5
    assert got.energy_error_estimate > 0.3


def test_two_thirds_of_the_truth_within_one_std(glossy):
    wi, wo = pairs(GLOSSY, 3000, seed=9)
    inside = np.abs(glossy.eval(wi, wo) - GLOSSY.eval(wi, wo)) <= glossy.std(wi, wo)
    assert 0.60 < inside.mean() < 0.77


def test_saved_and_opened_it_says_the_same(glossy, tmp_path):
    save_brdf(glossy, tmp_path / "brdf.npz")
    again = gonio.load_brdf(tmp_path / "brdf.npz")
    wi, wo = pairs(GLOSSY, 500, seed=2)
    u = np.random.default_rng(0).random((500, 2))
    assert np.array_equal(again.eval(wi, wo), glossy.eval(wi, wo))
    assert np.array_equal(again.std(wi, wo), glossy.std(wi, wo))
    assert np.array_equal(again.sample(wi, u)[0], glossy.sample(wi, u)[0])
    assert again.energy_error_estimate == glossy.energy_error_estimate
    assert again.notes == glossy.notes


def test_same_samples_and_seed_same_brdf(glossy):
    again = reconstruct(samples(GLOSSY, 2000))
    assert np.array_equal(again.table.table.values, glossy.table.table.values)


def test_nothing_below_the_horizon_and_all_finite(glossy):
    rng = np.random.default_rng(1)
    w = rng.standard_normal((4000, 2, 3))
    w /= np.linalg.norm(w, axis=2, keepdims=True)
    w[:10, :, 2] = 1e-9
    f, std = glossy.eval(w[:, 0], w[:, 1]), glossy.std(w[:, 0], w[:, 1])
    assert np.isfinite(f).all() and (f >= 0).all() and np.isfinite(std).all()
    below = (w[:, :, 2] <= 0).any(1)
    assert not f[below].any() and not std[below].any()
    assert glossy.eval(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 3)


@pytest.mark.slow
@pytest.mark.parametrize("truth, psi", [(BRUSHED, 0), (BECKMANN, 90)])
def test_anisotropic(truth, psi):
    got = reconstruct(samples(truth, 3000), anisotropic=True)
    assert energy_error(got, truth) < 0.06
    assert abs(np.cos(np.radians(psi) - got.table.frame.psi)) > 0.99
    assert 0.5 < got.energy_error_estimate / energy_error(got, truth) < 2


def test_control_a_brushed_surface_is_not_isotropic():
    assert energy_error(fit_running(samples(BRUSHED, 2000)), BRUSHED) > 0.2


def test_mirror_images_are_used_where_the_data_are_reciprocal(glossy):
    assert glossy.notes["reciprocal"] == 1
    got = reconstruct(samples(OneWay(), 2000))
    assert got.notes["reciprocal"] == 0
    assert energy_error(got, OneWay()) < 0.03


def test_running_is_a_surrogate_with_a_floor():
    got = fit_running(samples(GLOSSY, 1000))
    wi, wo = pairs(GLOSSY, 300, seed=4)
    assert (got.eval(wi, wo) > 0).all()
    assert 0.5 < got.energy_error_estimate / energy_error(got, GLOSSY) < 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper_white", "cc_ibiza_sunset"])
def test_measured_tables(name, rgl_dir, score):
    from gonio.brdf import RglBrdf

    truth = RglBrdf.from_file(rgl_dir / f"{name}_rgb.bsdf")
    rng = np.random.default_rng(0)
    wi, wo = pairs(GLOSSY, 1500)
    f = truth.eval(wi, wo)
    s = samples(GLOSSY, 1500)
    sigma = np.hypot(0.005 * f, 3e-5 / wi[:, 2:])
    got = reconstruct(type(s).of(wi, wo, f + sigma * rng.standard_normal(f.shape), sigma))
    figures = score.score(got.eval, truth.eval, n=1000)
    assert figures["energy_mean"] < {"paper_white": 0.03, "cc_ibiza_sunset": 0.10}[name]
