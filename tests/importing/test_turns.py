"""Whether a surface changes as it is turned, seen in readings at random, on lattices and in other programs' files."""

import numpy as np
import pytest
from importing.test_readers import opened

from gonio.brdf import Ggx, Lambert, Mixture, RglBrdf
from gonio.export.exchange.zemax import write_zemax
from gonio.export.mountain import write_mountain
from gonio.geometry import from_angles
from gonio.importing.directions import about_mirror, turned
from gonio.importing.doubt import turns_with_sample

BRUSHED = Mixture([Lambert(0.2), Ggx(0.15, 0.4, f0=0.5)], [0.5, 0.5])


def at_random(n=6000):
    rng = np.random.default_rng(5)
    theta_i, theta_o = np.arccos(rng.random((2, n)) * 0.9 + 0.1)
    phi_i, phi_o = 2 * np.pi * rng.random((2, n))
    return from_angles(theta_i, phi_i), from_angles(theta_o, phi_o)


def lattice():
    """As Zemax has it."""
    radial = np.concatenate([[0], np.geomspace(1, 175, 30)])
    axes = np.arange(0, 360, 30.0), np.arange(0, 81, 10.0), np.arange(0, 360, 30.0), radial
    r, i, a, s = (np.radians(x.ravel()) for x in np.meshgrid(*axes, indexing="ij"))
    wi, wo = (turned(w, r) for w in about_mirror(i, s, a))
    return wi[wo[:, 2] > 0.01], wo[wo[:, 2] > 0.01]


PLACES = {"random": at_random(), "lattice": lattice()}


@pytest.mark.parametrize("places, f0", [("random", 0.5), ("lattice", 0.5), ("random", 0.1), ("lattice", 0.04)])
def test_a_brushed_surface_turns_and_be_it_dull(places, f0):
    brdf = Mixture([Lambert(0.3), Ggx(0.15, 0.4, f0=f0)], [0.7, 0.3])
    assert turns_with_sample(*PLACES[places], brdf.eval(*PLACES[places]))


@pytest.mark.parametrize("places", PLACES)
@pytest.mark.parametrize("name", ["chm_orange", "ilm_solo_m_68", "irid_flake_paint1"])
def test_isotropic_materials_do_not_turn(name, places, rgl_dir):
    f = RglBrdf.from_file(rgl_dir / f"{name}_rgb.bsdf").eval(*PLACES[places])
    noise = np.random.default_rng(1).standard_normal((len(f), 1))
    assert not turns_with_sample(*PLACES[places], f)
    assert not turns_with_sample(*PLACES[places], f * np.exp(0.05 * noise))


def test_exports_of_a_brushed_surface_come_back_as_such(tmp_path):
    write_zemax(BRUSHED, tmp_path / "x.bsdf")
    t = opened(tmp_path / "x.bsdf")
    assert not t.isotropic and any("as the file says" in line for line in t.said)
    assert turns_with_sample(t.wi, t.wo, t.f)
    write_mountain(BRUSHED, tmp_path / "pab", (0.0, 20.0, 40.0, 60.0))
    assert not opened(tmp_path / "pab").isotropic
