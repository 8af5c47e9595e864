"""Micro-surfaces against what is known without them: a flat one is its facet, rays traced one by one agree."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

import gonio
from gonio.brdf import BrdfFileError
from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.brdf.surfaces.micro import MicroSurface
from gonio.brdf.surfaces.shapes import CELLS, Shape, brushed, normals, woven
from gonio.geometry import from_angles, half_vector


def pairs(n, seed=0, highest=80.0):
    rng = np.random.default_rng(seed)
    theta = np.radians(highest) * np.sqrt(rng.random((2, n)))
    return tuple(from_angles(t, p) for t, p in zip(theta, 2 * np.pi * rng.random((2, n))))


def test_a_flat_surface_is_its_facet():
    flat = np.zeros((CELLS, CELLS))
    s = MicroSurface(Shape(flat, 0.3, np.full((*flat.shape, 3), 0.2), np.full((*flat.shape, 3), 0.5)), points=64)
    wi, wo = pairs(300)
    known = Mixture([Lambert([0.2] * 3), Ggx(0.3, None, [0.5] * 3)]).eval(wi, wo)
    lambda_i, lambda_o = (0.5 * (np.sqrt(1 + 0.09 * (1 / w[:, 2] ** 2 - 1)) - 1) for w in (wi, wo))
    # the model shadows by 1 / (1 + L_i + L_o), facets one by one by the product
    separate = ((1 + lambda_i + lambda_o) / ((1 + lambda_i) * (1 + lambda_o)))[:, None]
    lobe = known - 0.2 / np.pi
    np.testing.assert_allclose(s.eval(wi, wo), 0.2 / np.pi + lobe * separate, rtol=1e-10)
    assert np.allclose(s.std(wi, wo), 0, atol=1e-12)


@pytest.fixture(scope="module", params=["micro_brushed", "micro_woven"])
def surface(request):
    return gonio.load_brdf(request.param)


def test_it_is_reciprocal_and_loses_energy_only(surface):
    wi, wo = pairs(400, highest=88)
    np.testing.assert_allclose(surface.eval(wi, wo), surface.eval(wo, wi), rtol=1e-9)
    u = np.random.default_rng(1).random((3000, 2))
    for theta, phi in ((0.1, 0.3), (0.8, 1.5), (1.2, 0.0)):
        w = np.tile(from_angles(np.array([theta]), np.array([phi])), (len(u), 1))
        wo, pdf = surface.sample(w, u)
        ok = pdf > 0
        albedo = (surface.eval(w[ok], wo[ok]) * (wo[ok, 2] / pdf[ok])[:, None]).sum(0) / len(u)
        assert (albedo < 1.03).all() and (albedo > 0.05).all()


def test_it_is_not_isotropic():
    wi, wo = pairs(200)
    turned = [w @ np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]]) for w in (wi, wo)]
    brush = gonio.load_brdf("micro_brushed")
    ratio = brush.eval(*turned) / brush.eval(wi, wo)
    assert np.std(np.log(ratio)) > 0.3


def marched(height, start, w, cells=300):
    """Whether rays from the surface at `start` (P, 2) along w get away, (P,): by small steps, without horizons."""
    z = map_coordinates(height, start.T, order=1, mode="grid-wrap") + 1e-3
    free = np.ones(len(start), bool)
    run = np.hypot(w[0], w[1])
    for s in np.arange(0.5, cells, 0.5):
        at = start + s * w[:2] / run
        free &= map_coordinates(height, at.T % CELLS, order=1, mode="grid-wrap") <= z + s * w[2] / run
        if s * w[2] / run > height.max() - height.min():
            break
    return free


@pytest.mark.parametrize("make", [lambda: brushed(1), woven], ids=["brushed", "woven"])
def test_rays_traced_one_by_one_say_the_same(make):
    shape = make()
    s, n = MicroSurface(shape), normals(shape.height)
    at = np.random.default_rng(4).integers(0, CELLS, (12_000, 2))
    n, diffuse = n[at[:, 0], at[:, 1]], shape.diffuse[at[:, 0], at[:, 1]] / np.pi
    f0 = shape.f0[at[:, 0], at[:, 1]]
    wi, wo = pairs(6, seed=9, highest=75)
    said, error = s.eval(wi, wo), s.std(wi, wo)
    hidden = 0
    for k in range(len(wi)):
        h = half_vector(wi[k : k + 1], wo[k : k + 1])[0]
        ci, co, ch = (np.maximum(n @ w, 0) for w in (wi[k], wo[k], h))
        seen = marched(shape.height, at.astype(float), wi[k]) & marched(shape.height, at.astype(float), wo[k])
        hidden += np.mean(~seen)
        tan2 = (1 - ch**2) / np.maximum(ch, 1e-9) ** 2
        d = 1 / (np.pi * shape.alpha**2 * np.maximum(ch, 1e-9) ** 4 * (1 + tan2 / shape.alpha**2) ** 2)
        g = np.ones(len(n))
        for c in (ci, co):
            g *= 2 / (1 + np.sqrt(1 + shape.alpha**2 * (1 - c**2) / np.maximum(c, 1e-9) ** 2))
        f = f0 + (1 - f0) * (1 - wi[k] @ h) ** 5
        each = diffuse * (ci * co)[:, None] + f * (d * g / 4 * (ci > 0) * (co > 0))[:, None]
        each *= (seen / n[:, 2])[:, None] / (wi[k, 2] * wo[k, 2])
        sd = np.hypot(each.std(0) / np.sqrt(len(each)), error[k])
        assert (np.abs(each.mean(0) - said[k]) < 4 * sd + 0.01 * said[k]).all()
    assert hidden > 0.1  # or nothing was said about shadows


def test_more_points_have_smaller_errors():
    wi, wo = pairs(60)
    few, many = (MicroSurface(brushed(1), points=p).std(wi, wo).mean() for p in (256, 4096))
    assert 2.5 < few / many < 6.5


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("surface: velvet", "velvet"),
        ("surface: woven\nyarns: 3", "yarns: no such key"),
        ("surface: brushed\nseed: -1", "seed"),
    ],
)
def test_bad_files_are_named(tmp_path, text, what):
    (tmp_path / "x.yaml").write_text(f"name: x\n{text}\n")
    with pytest.raises(BrdfFileError, match=f"x.yaml.*{what}"):
        gonio.load_brdf(tmp_path / "x.yaml")
