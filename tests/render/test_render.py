"""The shaded sphere, the meshes, the environment maps, and Mitsuba where it is installed."""

import json

import numpy as np
import pytest

from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.render.environment import ENVIRONMENTS
from gonio.render.objects import preview
from gonio.render.shade import psnr, render_sphere, to_srgb

GLOSS = Mixture([Lambert([0.3, 0.2, 0.1]), Ggx(0.2, None, [0.1, 0.1, 0.1])])


def test_a_white_sphere_under_an_even_sky_is_white(monkeypatch):
    """White furnace: a Lambertian of albedo 1 sends back what it gets, wherever it is looked at."""
    from gonio.render import shade

    monkeypatch.setattr(shade, "sky", lambda w: np.ones((len(w), 3)))
    monkeypatch.setattr(shade, "LAMPS", ())
    image = render_sphere(Lambert([1.0, 1.0, 1.0]), size=32, spp=4)
    inside = image[image.sum(-1) > 0]
    assert np.allclose(inside, 1, atol=1e-9)


def test_the_picture_does_not_depend_on_who_draws_the_directions():
    a = render_sphere(GLOSS, size=40, spp=64)
    b = render_sphere(GLOSS, size=40, spp=64, sampler=Lambert([1.0, 1.0, 1.0]), seed=2)
    assert abs(a.mean() / b.mean() - 1) < 0.03
    assert psnr(a, a) == float("inf") and psnr(a, b) > 20
    # negative control: another material is another picture
    c = render_sphere(Lambert([0.3, 0.2, 0.1]), size=40, spp=64)
    assert abs(a.mean() / c.mean() - 1) > 0.1


def test_srgb_ends_and_middle():
    assert np.allclose(to_srgb(np.array([0, 0.0031308, 0.5, 1, 2])), [0, 0.04045, 0.7353569, 1, 1], atol=1e-5)


def test_meshes_are_closed_up_and_their_normals_point_out(tmp_path):
    for mesh in preview():
        assert np.allclose(np.linalg.norm(mesh.normals, axis=1), 1)
        p = mesh.vertices[mesh.faces]
        area = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        side = np.einsum("ni,ni->n", area, mesh.normals[mesh.faces[:, 0]])
        assert (side >= -1e-9).mean() > 0.99
        mesh.write_obj(tmp_path / "m.obj")
        assert (tmp_path / "m.obj").read_text().count("\nf ") == len(mesh.faces)


@pytest.mark.parametrize("name", list(ENVIRONMENTS))
def test_environments_are_light(name):
    image = ENVIRONMENTS[name](64)
    assert image.shape == (64, 128, 3) and np.isfinite(image).all() and image.min() >= 0 and image.max() > 0.5


def test_rendered_beside_the_truth(tmp_path):
    mitsuba = pytest.importorskip("mitsuba", reason="mitsuba is in the render extra")
    pytest.importorskip("colour", reason="colour-science is in the render extra")
    from gonio.render.beside import render_beside

    mitsuba.set_variant("scalar_spectral")  # as somebody else in this process may have left it
    lines = render_beside(GLOSS, GLOSS, None, tmp_path, 32, 16)
    assert (tmp_path / "render.png").stat().st_size > 10_000 and len(lines) == 5
    table = json.loads((tmp_path / "render.json").read_text())
    assert all(set(row) == {"relMSE", "PSNR", "SSIM", "FLIP", "dE_ITP"} for row in table.values())
    # the two differ by the resolution of their tables and by nothing else
    assert all(row["PSNR"] > 30 for row in table.values())
