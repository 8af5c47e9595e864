"""One GGX lobe: what went in comes out."""

import numpy as np
import pytest
from reconstruct.pss_chain import samples

from gonio.brdf import Ggx
from gonio.geometry import from_angles
from gonio.reconstruct import ReconstructionError, Samples, reconstruct
from gonio.reconstruct.fits.ggx import fit_cosine_weighted

COLOURS = [0.8, 0.5, 0.2]


def around(brdf, n, seed=0):
    """Samples of brdf drawn by itself, over all azimuths."""
    rng = np.random.default_rng(seed)
    wi = from_angles(np.arccos(rng.uniform(0.1, 1, n)), 2 * np.pi * rng.random(n))
    wo, p = brdf.sample(wi, rng.random((n, 2)))
    return Samples.of(wi[p > 0], wo[p > 0], brdf.eval(wi, wo)[p > 0])


@pytest.mark.parametrize("alpha", [0.003, 0.05, 0.6])
def test_isotropic(alpha):
    brdf = reconstruct(samples(Ggx(alpha, f0=COLOURS), 500), "ggx")
    assert brdf.ndf.alpha_x == pytest.approx(alpha, rel=1e-3) and brdf.ndf.alpha_y == brdf.ndf.alpha_x
    np.testing.assert_allclose(brdf.f0 * brdf.weight, COLOURS, rtol=1e-2)


@pytest.mark.parametrize("alpha_x, alpha_y", [(0.05, 0.5)])
def test_anisotropic(alpha_x, alpha_y):
    brdf = reconstruct(around(Ggx(alpha_x, alpha_y, f0=COLOURS), 700), "ggx", anisotropic=True)
    assert brdf.ndf.alpha_x == pytest.approx(alpha_x, rel=5e-3)
    assert brdf.ndf.alpha_y == pytest.approx(alpha_y, rel=5e-3)


def test_noise_is_survived():
    s = samples(Ggx(0.1, f0=COLOURS), 1000)
    rng = np.random.default_rng(1)
    sigma = 0.02 * s.f + 1e-4
    noisy = Samples.of(s.wi, s.wo, s.f + sigma * rng.standard_normal(s.f.shape), sigma)
    assert reconstruct(noisy, "ggx").ndf.alpha_x == pytest.approx(0.1, rel=0.02)


def test_cosine_weighted_fit():
    assert fit_cosine_weighted(samples(Ggx(0.02, f0=COLOURS), 2000)).ndf.alpha_x == pytest.approx(0.02, rel=1e-3)


def test_refuses_too_few_and_black():
    s = samples(Ggx(0.1, f0=COLOURS), 100)
    with pytest.raises(ReconstructionError, match="usable samples"):
        reconstruct(s[:19], "ggx")
    with pytest.raises(ReconstructionError):
        reconstruct(Samples.of(s.wi, s.wo, 0 * s.f), "ggx")
