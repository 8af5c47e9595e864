"""The thesis's reconstruction: right on what it can do, and as wrong as it was found to be on what it cannot."""

import numpy as np
import pytest
from brdf.halfsquare import sample_p_value
from reconstruct.pss_chain import samples

from gonio.brdf import Ggx, Lambert, Mixture, RglBrdf
from gonio.brdf.tables.slices import incidence_grid, pdf_grid
from gonio.evaluate import evaluate
from gonio.geometry import from_angles
from gonio.load import load_brdf, save_brdf
from gonio.reconstruct import ReconstructionError, reconstruct
from gonio.reconstruct.fits.laplace import fill_holes

# energy_median at 10,000 samples as METHOD.md's section 6 has it; the glossy ones scatter with the seed by a third
TABLE = {"paper_white": 0.007, "cc_ibiza_sunset": 0.040, "satin_rosaline": 0.052}


@pytest.fixture(scope="module")
def rough():
    truth = Mixture([Lambert([0.1, 0.2, 0.3]), Ggx(0.3, f0=[0.5, 0.4, 0.3])])
    return truth, reconstruct(samples(truth, 4000), "thesis")


def test_a_rough_surface(rough):
    truth, brdf = rough
    figures = evaluate(brdf, truth)
    assert figures["energy_median"] < 0.02 and 0.97 < figures["bright_min"] < figures["bright_max"] < 1.03


@pytest.mark.parametrize("name", TABLE)
def test_table_of_the_method(rgl_dir, name):
    truth = RglBrdf.from_file(rgl_dir / f"{name}_rgb.bsdf")
    figures = evaluate(reconstruct(samples(truth, 10_000, seed=1), "thesis"), truth)
    assert figures["energy_median"] == pytest.approx(TABLE[name], rel=0.3)


def test_chrome_comes_out_too_bright(rgl_dir):
    """The known failure, which a better reconstruction must be measured against: 0.75, 1.1 ... 2.6 times too bright."""
    truth = RglBrdf.from_file(rgl_dir / "chm_orange_rgb.bsdf")
    figures = evaluate(reconstruct(samples(truth, 10_000, seed=1), "thesis"), truth)
    assert 0.5 < figures["energy_median"] < 1.0 and figures["bright_max"] > 1.5


def test_samples_follow_the_density(rough):
    for theta in (0.2, 0.9, 1.3):
        assert sample_p_value(rough[1], from_angles(theta, 0.8), 0.3, fine=32) > 1e-4


def test_saved_and_opened(rough, tmp_path):
    save_brdf(rough[1], tmp_path / "brdf.npz")
    wi, wo = from_angles(np.full(50, 0.7), 0.3), from_angles(np.linspace(0, 1.5, 50), 2.0)
    np.testing.assert_allclose(load_brdf(tmp_path).eval(wi, wo), rough[1].eval(wi, wo), rtol=1e-5)


def test_refusals():
    s = samples(Ggx(0.3, f0=[0.5, 0.4, 0.3]), 200)
    with pytest.raises(ReconstructionError, match="isotropic"):
        reconstruct(s, "thesis", anisotropic=True)
    with pytest.raises(ReconstructionError):
        reconstruct(s[np.zeros(200, int)], "thesis")


def test_grids():
    theta = incidence_grid(0.1, 64)
    assert theta[0] == 0 and np.degrees(theta[-1]) == pytest.approx(89.5) and np.all(np.diff(theta) > 0)
    # sigma(theta_i) is nearly cos(theta_i) on a smooth surface: the incidences are even in the sine
    np.testing.assert_allclose(np.diff(np.sin(incidence_grid(0.01, 64))), 1 / 63, rtol=0.02)
    p = pdf_grid(np.radians([0.0, 60.0]), 0.3, 65, 128)
    integral = lambda a: np.trapezoid(np.trapezoid(a, dx=1 / 127), dx=1 / 64)
    for grid in p:
        assert integral(grid) == pytest.approx(1, abs=1e-3)


def test_holes_are_filled_harmonically():
    v, u = np.meshgrid(np.linspace(0, 2 * np.pi, 33), np.linspace(0, 1, 20), indexing="ij")
    truth = np.stack([2 + 3 * u, 2 + np.cos(v) * np.exp(-u)], -1)
    holes = truth.copy()
    holes[5:15, 4:9] = np.nan
    holes[[0, -1], 10:12] = np.nan
    filled = fill_holes(holes)
    np.testing.assert_allclose(filled[..., 0], truth[..., 0], atol=1e-10)  # a plane is harmonic
    known = ~np.isnan(holes)
    np.testing.assert_array_equal(filled[known], truth[known])
    low, high = np.nanmin(holes[..., 1]), np.nanmax(holes[..., 1])
    assert np.isfinite(filled).all() and low <= filled[..., 1].min() and filled[..., 1].max() <= high
    np.testing.assert_array_equal(filled[0], filled[-1])
