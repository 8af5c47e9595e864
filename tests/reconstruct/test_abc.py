"""Löw's ABC model is found again, and converges on measured tables (those where the thesis's optimiser failed)."""

import numpy as np
import pytest
from reconstruct.pss_chain import samples

from gonio.brdf import Abc, RglBrdf
from gonio.evaluate import evaluate
from gonio.reconstruct import ReconstructionError, reconstruct
from gonio.reconstruct.fits.log_nnls import log_nnls


@pytest.mark.parametrize("b, c", [(300.0, 2.0), (3e5, 1.2)])
def test_found_again(b, c):
    truth = Abc([0.3, 0.2, 0.1], [4.0, 3.0, 2.0], b, c, 1.5)
    figures = evaluate(reconstruct(samples(truth, 1000), "abc"), truth)
    assert figures["energy_max"] < 0.02


@pytest.mark.parametrize("name, worst", [("satin_rosaline", 0.25), ("cm_toxic_green", 0.25), ("cardboard", 0.2)])
def test_measured_tables(rgl_dir, name, worst):
    truth = RglBrdf.from_file(rgl_dir / f"{name}_rgb.bsdf")
    assert evaluate(reconstruct(samples(truth, 1000), "abc"), truth)["energy_mean"] < worst


def test_isotropic_only():
    with pytest.raises(ReconstructionError, match="isotropic"):
        reconstruct(samples(Abc(0.3, 4.0, 300.0, 2.0), 100), "abc", anisotropic=True)


def test_log_nnls_is_the_least_of_logarithms():
    """No small step from the solution is better; relative weights alone, the usual short cut, are far too dark."""
    rng = np.random.default_rng(0)
    columns = rng.random((400, 2)) ** 3
    target = columns @ [2.0, 0.5] * np.exp(0.5 * rng.standard_normal(400))
    floor = np.full(400, 1e-3)
    loss = lambda x: np.mean((np.log(columns @ x + floor) - np.log(target + floor)) ** 2)
    x = log_nnls(columns, target, floor)
    assert np.all(np.abs(np.log(x / [2.0, 0.5])) < 0.3)
    for step in (1e-2, -1e-2):
        assert loss(x * [1 + step, 1]) > loss(x) - 1e-5 and loss(x * [1, 1 + step]) > loss(x) - 1e-5
    w = 1 / (target + floor)
    short_cut = np.linalg.lstsq(columns * w[:, None], target * w, rcond=None)[0]
    assert short_cut.sum() < 0.85 * x.sum()
