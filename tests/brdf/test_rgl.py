"""RGL tables against the referee's own reader, and their sampler against its density."""

import numpy as np
import pytest
from brdf.halfsquare import integrals, p_value, sample_p_value
from brdf.tables import anisotropic_fields, isotropic_fields

from gonio.brdf import BrdfFileError, NetworkBrdf, RglBrdf
from gonio.brdf.tables.tensor_file import read_tensor_file, write_tensor_file
from gonio.geometry import from_angles, reflect

WIDTHS = {"paper_white": 0.5, "satin_rosaline": 0.05, "cg_sunflower": 0.004, "chm_orange": 0.002}


def pairs(n, seed=0):
    """Half of them uniform, half with half vectors 1e-4 to 1 rad from the normal."""
    rng = np.random.default_rng(seed)
    wi, wo = (from_angles(np.arccos(rng.random(n)), 2 * np.pi * rng.random(n)) for _ in range(2))
    k = n // 2
    h = from_angles(10 ** rng.uniform(-4, 0, k), 2 * np.pi * rng.random(k))
    wo[:k] = reflect(wi[:k], h)
    return wi, wo


def test_agrees_with_the_referee(rgl_dir, score):
    wi, wo = pairs(20_000)
    wi, wo = wi[wo[:, 2] > 1e-5], wo[wo[:, 2] > 1e-5]
    for path in sorted(rgl_dir.glob("*.bsdf")):
        theirs, ours = score.RGL(str(path)).eval(wi, wo), RglBrdf.from_file(path).eval(wi, wo)
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-9 * theirs.max(), err_msg=path.name)


def test_networks_agree_with_the_referee(shared_dir, score):
    path = shared_dir / "materials" / "nbrdf" / "nbrdf.npz"
    wi, wo = pairs(2000)
    for name in list(np.load(path)["names"])[::10]:
        theirs = score.Network(f"{path}:{name}").eval(wi, wo)
        np.testing.assert_allclose(NetworkBrdf.from_file(path, name).eval(wi, wo), theirs, rtol=1e-5, atol=1e-9)


@pytest.mark.parametrize("name", WIDTHS)
def test_samples_of_a_measured_table(rgl_dir, name):
    brdf = RglBrdf.from_file(rgl_dir / f"{name}_rgb.bsdf")
    for k, theta in enumerate(np.radians([10, 45, 70])):
        wi = from_angles(theta, 0.9)
        assert sample_p_value(brdf, wi, WIDTHS[name], seed=k, fine=32) > 1e-4


def tables():
    yield pytest.param(isotropic_fields(), id="isotropic")
    for turn in (1, 2, 4):
        yield pytest.param(anisotropic_fields(turn), id=f"anisotropic over 1/{turn} turn")


@pytest.mark.parametrize("fields", tables())
def test_samples_of_a_synthetic_table(fields):
    brdf, n = RglBrdf(fields), 40_000
    for k, (theta, phi) in enumerate([(0.0, 0.0), (0.9, -2.0), (1.2, 2.8)]):
        wi = from_angles(theta, phi)
        cells = integrals(brdf.pdf, wi, 0.3, fine=32)
        wo, p = brdf.sample(np.tile(wi, (n, 1)), np.random.default_rng(k).random((n, 2)))
        assert p_value(wo, p, wi, 0.3, cells) > 1e-4
        kept = np.mean(p > 0)
        assert abs(cells.sum() - kept) < 1e-3 + 4 * np.sqrt(kept * (1 - kept) / n)


def test_a_wrong_table_density_is_found_out():
    brdf, other = RglBrdf(isotropic_fields()), RglBrdf(isotropic_fields(alpha=0.33))
    assert sample_p_value(brdf, from_angles(0.9, 0.3), 0.3, pdf=other.pdf) < 1e-6


def test_symmetric_tables_are_the_whole_by_symmetry():
    """Of one elliptic lobe: the table over the full turn, half of it and a quarter say the same."""
    wi, wo = pairs(3000)
    # odd grids: with 49 nodes the mirrored node is a node
    whole, half, quarter = (RglBrdf(anisotropic_fields(turn, n=49)).eval(wi, wo) for turn in (1, 2, 4))
    np.testing.assert_allclose(half, whole, rtol=1e-3, atol=1e-5)
    np.testing.assert_allclose(quarter, whole, rtol=1e-3, atol=1e-5)


def test_round_trip_through_a_file(tmp_path):
    fields = anisotropic_fields(1)
    write_tensor_file(tmp_path / "x.bsdf", fields)
    back = read_tensor_file(tmp_path / "x.bsdf")
    assert list(back) == list(fields)
    for key in fields:
        assert back[key].dtype == fields[key].dtype
        np.testing.assert_array_equal(back[key], fields[key])


def test_spectra_are_channels(tmp_path):
    fields = isotropic_fields()
    fields["wavelengths"] = np.linspace(400, 700, 7, dtype=np.float32)
    fields["spectra"] = np.repeat(fields.pop("rgb")[:, :, :1], 7, axis=2)
    brdf = RglBrdf(fields)
    assert brdf.channels == 7 and list(brdf.wavelengths[[0, -1]]) == [400, 700]
    wi, wo = pairs(100)
    np.testing.assert_allclose(brdf.eval(wi, wo)[:, 3], RglBrdf(isotropic_fields()).eval(wi, wo)[:, 0])


@pytest.mark.parametrize(
    "key, change, word",
    [
        ("theta_i", lambda a: a[::-1], "ascending"),
        ("vndf", lambda a: a * np.nan, "NaN"),
        ("ndf", lambda a: -a, "negative"),
        ("rgb", lambda a: a[:, :, :2], "channels"),
        ("sigma", lambda a: a * 0, "holds 0"),
        ("luminance", lambda a: a[:, :1], "slices"),
        ("vndf", lambda a: a[..., :1], "nodes"),
        ("phi_i", lambda a: a.astype(np.int32), "int32"),
    ],
)
def test_wrong_fields_are_named(key, change, word):
    fields = isotropic_fields()
    fields[key] = change(fields[key])
    with pytest.raises(BrdfFileError, match=rf"'{key}'.*{word}"):
        RglBrdf(fields, "x.bsdf")


def test_missing_field_is_named():
    fields = isotropic_fields()
    del fields["vndf"]
    with pytest.raises(BrdfFileError, match=r"x\.bsdf: field 'vndf' is missing"):
        RglBrdf(fields, "x.bsdf")
