"""Wrong guesses contradict physics, and are said; right ones are not doubted."""

import numpy as np
import pytest
from importing import files
from importing.test_readers import opened

from gonio.brdf import Ggx, Lambert, RglBrdf
from gonio.geometry import from_angles
from gonio.importing.delimited import Choices
from gonio.importing.doubt import doubts, turns_with_sample

ANGLES = {"grid": files.grid(10, 5, 15), "scattered": files.scattered()}


def said(tmp_path, angles, change, **options):
    (tmp_path / "x.csv").write_text(files.csv(angles, change))
    return opened(tmp_path / "x.csv", **options).doubts


@pytest.mark.parametrize("angles", ANGLES)
def test_each_wrong_guess_is_found(angles, tmp_path):
    a = ANGLES[angles]
    assert not said(tmp_path, a, lambda f, wo: f).lines
    found = said(tmp_path, a, lambda f, wo: f * wo[:, 2:])
    assert "--value f_cos" in found.lines[0] and abs(found.slope - 1) < 0.1
    found = said(tmp_path, a, lambda f, wo: f, value="f_cos")
    assert "--value f)" in found.lines[0] and abs(found.slope + 1) < 0.1
    assert not said(tmp_path, a, lambda f, wo: f * wo[:, 2:], value="f_cos").lines
    found = said(tmp_path, a, lambda f, wo: 1.5 * np.pi * f)
    assert "--value factor" in found.lines[-1]
    radians = said(tmp_path, np.radians(a), lambda f, wo: f)
    assert "radians taken as degrees" in radians.lines[0]
    degrees = said(tmp_path, a, lambda f, wo: f, choices=Choices("radians"))
    assert "degrees taken as radians" in degrees.lines[0]


def test_noise_is_no_contradiction(tmp_path):
    noise = lambda f, wo: f * (1 + 0.1 * np.random.default_rng(3).standard_normal(f.shape))
    assert not said(tmp_path, ANGLES["scattered"], noise).lines


@pytest.mark.parametrize("name", ["chm_orange", "cc_ibiza_sunset", "paper_white", "satin_rosaline", "ilm_solo_m_68"])
def test_measured_tables_are_not_doubted_and_their_wrong_readings_are(name, rgl_dir):
    table = RglBrdf.from_file(rgl_dir / f"{name}_rgb.bsdf")
    wi, wo = files.pairs(*files.scattered(4000))
    f = table.eval(wi, wo)
    assert not doubts(wi, wo, f, 0, "f").lines
    found = doubts(wi, wo, f * wo[:, 2:], 0, "f")
    assert any("--value f_cos" in line for line in found.lines)


def test_few_readings_say_nothing():
    wi, wo = files.pairs(*files.scattered(30))
    found = doubts(wi, wo, 3 * np.ones((30, 1)), 0, "f")
    assert not found.lines and np.isnan(found.slope) and "reciprocity is not tested" in found.notes[0]


def test_too_few_exchanges_are_noted_and_enough_are_not(tmp_path):
    one_way = [a[files.grid()[0] < files.grid()[1]] for a in files.grid()]
    (tmp_path / "x.csv").write_text(files.csv(one_way))
    assert any("reciprocity is not tested" in line for line in opened(tmp_path / "x.csv").said)
    (tmp_path / "x.csv").write_text(files.csv(files.scattered()))
    assert not any("reciprocity" in line for line in opened(tmp_path / "x.csv").said)


@pytest.mark.parametrize("power, doubted", [(-0.65, False), (-1, True)])
def test_values_somewhat_too_large_at_grazing_are_no_contradiction(power, doubted):
    wi, wo = files.pairs(*files.scattered())
    found = doubts(wi, wo, 0.3 * files.GREY.eval(wi, wo) * wo[:, 2:] ** power, 0, "f")
    assert abs(found.slope - power) < 0.1 and found.slope_u < 0.2
    assert any("reciprocity" in line for line in found.lines) == doubted


def test_a_diffuser_has_no_mirror_direction():
    wi, wo = files.pairs(*files.scattered(2000))
    assert not doubts(wi, wo, Lambert(0.9).eval(wi, wo), 0, "f").lines


def test_anisotropy_is_seen():
    rng = np.random.default_rng(5)
    n = 6000
    theta_i, theta_o = np.arccos(rng.random((2, n)) * 0.9 + 0.1)
    wi, wo = from_angles(theta_i, 2 * np.pi * rng.random(n)), from_angles(theta_o, 2 * np.pi * rng.random(n))
    assert turns_with_sample(wi, wo, Ggx(0.15, 0.5, f0=0.5).eval(wi, wo))
    assert not turns_with_sample(wi, wo, Ggx(0.25, f0=0.5).eval(wi, wo))


def test_odd_values_are_counted(tmp_path):
    text = files.csv().split("\n")
    text[5] = text[5].rsplit(",", 3)[0] + ",nan,0.1,0.1"
    text[6] = text[6].rsplit(",", 3)[0] + ",-0.1,0.1,0.1"
    text[7] = "10,0,95,0,0.1,0.1,0.1"
    (tmp_path / "x.csv").write_text("\n".join(text))
    t = opened(tmp_path / "x.csv")
    words = " ".join(t.said)
    for what in ("1 of", "negative value", "below the horizon", "NaN"):
        assert what in words
    assert len(t.f) == len(text) - 2 - 2


@pytest.mark.parametrize("u, doubted", [(0.24, False), (0.1, True)])
def test_an_uncertain_slope_below_0_is_that_of_few_measurements(u, doubted, monkeypatch):
    """-0.88 ± 0.24 is what a BRDF of 80 measurements shows in its own export."""
    monkeypatch.setattr("gonio.importing.doubt._slope", lambda *_: (-0.88, u))
    wi, wo = files.pairs(*files.scattered())
    assert bool(doubts(wi, wo, files.GREY.eval(wi, wo), 0, "f").lines) == doubted
