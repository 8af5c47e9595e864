"""The fits that ship: readable, small, honest about how good they are."""

from importlib.resources import files

import numpy as np
import pytest
import yaml
from brdf.halfsquare import sample_p_value

import gonio
from gonio.brdf import BrdfFileError, RglBrdf
from gonio.brdf.library import find
from gonio.brdf.models.fitted import SPLINES, FittedBrdf, basis
from gonio.evaluate import evaluate
from gonio.geometry import from_angles

NAMES = ["acrylic_felt_purple", "aurora_white", "cc_ibiza_sunset", "chm_orange", "ilm_solo_m_68"]


@pytest.fixture(autouse=True)
def no_tables(monkeypatch, tmp_path):
    monkeypatch.delenv("GONIO_MATERIALS", raising=False)
    monkeypatch.setenv("GONIO_CACHE", str(tmp_path))


@pytest.mark.parametrize("name", NAMES)
def test_ships(name):
    found = find(name)
    assert "fit" in found.origin and found.path.suffix == ".yaml"
    brdf = gonio.load_brdf(name)
    assert isinstance(brdf, FittedBrdf) and brdf.alpha.size + brdf.colour.size <= 80
    rng = np.random.default_rng(0)
    wi, wo = (from_angles(np.arccos(rng.random(300)), 2 * np.pi * rng.random(300)) for _ in range(2))
    np.testing.assert_allclose(brdf.eval(wi, wo), brdf.eval(wo, wi), rtol=1e-9)
    assert np.all(brdf.eval(wi, wo) >= 0)
    assert sample_p_value(brdf, from_angles(0.7, 0.2), brdf.alpha[0], n=20_000) > 1e-4


@pytest.mark.parametrize("name", NAMES)
def test_figures_in_the_file_are_those_measured(name, rgl_dir):
    path = files("sim") / "materials" / f"{name}.yaml"
    written = yaml.safe_load(path.read_text())["figures"]
    measured = evaluate(FittedBrdf.from_file(path), RglBrdf.from_file(rgl_dir / f"{name}_rgb.bsdf"))
    assert written == pytest.approx(measured, abs=2e-4)


def test_the_analytic_one_ships():
    brdf = gonio.load_brdf("analytic_gloss")
    n = np.array([[0.0, 0.0, 1.0]])
    want = np.array([0.6, 0.25, 0.1]) / np.pi + 0.04 / (4 * np.pi * 0.08**2)
    np.testing.assert_allclose(brdf.eval(n, n)[0], want, rtol=1e-12)


def test_splines():
    b = basis(np.linspace(0, np.pi / 2, 200))
    assert b.shape == (200, SPLINES) and b.min() >= 0
    np.testing.assert_allclose(b.sum(1), 1, atol=1e-12)
    assert b[0, 0] == 1 and b[-1, -1] == pytest.approx(1)


@pytest.mark.parametrize("content", ["", "alpha: [1]", "alpha: [-1]\ncolour: [[[1]]]", "a: [", "[1, 2]", "\x00"])
def test_bad_files(tmp_path, content):
    (tmp_path / "x.yaml").write_text(content)
    with pytest.raises(BrdfFileError, match=r"x\.yaml") as e:
        gonio.load_brdf(tmp_path / "x.yaml")
    assert "\n" not in str(e.value)
