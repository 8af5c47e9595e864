"""What is exported as .bsdf is the BRDF: in our own reader, and in stock Mitsuba 3."""

import numpy as np
import pytest
from brdf.halfsquare import sample_p_value

from gonio import load_brdf
from gonio.brdf import Ggx, Lambert, Mixture, RglBrdf
from gonio.brdf.tables.tensor_file import read_tensor_file
from gonio.evaluate import evaluate
from gonio.export import ExportError
from gonio.export.bsdf import as_brdf, write_bsdf
from gonio.export.spectrum import WAVELENGTHS, rgb_response, upsample
from gonio.geometry import from_angles, reflect

ANGLES = np.radians([10, 25, 45, 60, 75])


def glossy(alpha, alpha_y=None):
    return Mixture([Lambert([0.1, 0.2, 0.3]), Ggx(alpha, alpha_y, f0=[0.5, 0.4, 0.3])], [0.3, 0.7])


def lit_pairs(brdf, theta_i, phi_i=0.3, n=1500, seed=0):
    """wi, wo drawn by the BRDF itself and uniformly, where its f cos(theta_o) is above 1 % of its peak."""
    rng = np.random.default_rng(seed)
    wi = np.tile(from_angles(theta_i, phi_i), (2 * n, 1))
    wo, _ = brdf.sample(wi, rng.random((2 * n, 2)))
    wo[n:] = from_angles(np.arccos(rng.random(n)), 2 * np.pi * rng.random(n))
    wo[: n // 4] = reflect(wi[: n // 4], from_angles(np.linspace(5e-5, 1e-3, n // 4), 5.0))
    wi, wo = wi[wo[:, 2] > 0], wo[wo[:, 2] > 0]
    f_cos = brdf.eval(wi, wo) * wo[:, 2:]
    lit = (f_cos > 0.01 * f_cos.max(0)).all(1)
    return wi[lit], wo[lit]


def worst(brdf, table, theta_i, quantile=1.0):
    wi, wo = lit_pairs(brdf, theta_i)
    return np.quantile(np.abs(table.eval(wi, wo) / brdf.eval(wi, wo) - 1), quantile)


@pytest.mark.parametrize("alpha", [0.002, 0.02, 0.3])
def test_within_two_percent(alpha):
    brdf = glossy(alpha)
    table = as_brdf(brdf)
    for theta in ANGLES:
        # f cos of a rough surface ends at the horizon with a kink within a cell of the table: 3 % in the last degrees
        assert worst(brdf, table, theta, 1.0 if alpha < 0.1 else 0.88) < 0.022, np.degrees(theta)
        assert worst(brdf, table, theta, 0.95) < 0.035, np.degrees(theta)
    figures = evaluate(table, brdf)
    assert figures["energy_mean"] < 0.01 and 0.99 < figures["bright_min"] < figures["bright_max"] < 1.01


@pytest.mark.parametrize("name, most", [("satin_rosaline", 0.02), ("chm_orange", 0.05), ("paper_white", 0.01)])
def test_measured_tables_survive(rgl_dir, name, most):
    truth = RglBrdf.from_file(rgl_dir / f"{name}_rgb.bsdf")
    figures = evaluate(as_brdf(truth), truth)
    assert figures["energy_mean"] < most and figures["energy_median"] < most / 2


def test_sampling_is_nearly_perfect_and_follows_its_density():
    table = as_brdf(glossy(0.05))
    wi = from_angles(np.radians(50), 0.4)
    assert sample_p_value(table, wi, 0.05) > 1e-4
    u = np.random.default_rng(0).random((20_000, 2))
    wo, p = table.sample(np.tile(wi, (len(u), 1)), u)
    value = (table.eval(np.tile(wi, (len(u), 1)), wo) @ [0.2126, 0.7152, 0.0722] * wo[:, 2])[p > 0] / p[p > 0]
    assert value.std() / value.mean() < 0.1


@pytest.mark.parametrize("spectral", [False, True])
def test_mitsuba_says_the_same(tmp_path, spectral):
    mi = pytest.importorskip("mitsuba")
    variant = "scalar_spectral" if spectral else "scalar_rgb"
    if variant not in mi.variants():
        pytest.skip(f"this mitsuba has no {variant}")
    mi.set_variant(variant)
    brdf = glossy(0.01)
    write_bsdf(brdf, tmp_path / "x.bsdf", spectral=spectral)
    plugin = mi.load_dict({"type": "measured", "filename": str(tmp_path / "x.bsdf")})
    context, si = mi.BSDFContext(), mi.SurfaceInteraction3f()
    if spectral:
        si.wavelengths = [450.0, 500.0, 550.0, 640.0]
        basis = np.array([[np.interp(w, WAVELENGTHS, b) for b in upsample().T] for w in si.wavelengths])
    table = RglBrdf.from_file(tmp_path / "x.bsdf")
    for theta in ANGLES:
        wi, wo = lit_pairs(brdf, theta, n=120)
        rows = []
        for a, b in zip(wi, wo):
            si.wi = mi.Vector3f(*a)
            v = plugin.eval(context, si, mi.Vector3f(*b))
            rows.append([v[k] for k in range(4 if spectral else 3)] + [plugin.pdf(context, si, mi.Vector3f(*b))])
        rows = np.array(rows)
        want = brdf.eval(wi, wo) * wo[:, 2:]
        want = want @ basis.T if spectral else want
        assert np.max(np.abs(rows[:, :-1] / want - 1)) < 0.02
        np.testing.assert_allclose(rows[:, -1], table.pdf(wi, wo), rtol=2e-3)


def test_anisotropic():
    brdf = glossy(0.08, 0.4)
    table = as_brdf(brdf, incidences=12, resolution=24)
    assert not table.isotropic and as_brdf(glossy(0.2), incidences=8, resolution=16).isotropic
    for phi in (0.1, 1.0, -2.5):
        wi, wo = lit_pairs(brdf, np.radians(40), phi)
        error = np.abs(table.eval(wi, wo) / brdf.eval(wi, wo) - 1)
        assert np.median(error) < 0.02 and np.quantile(error, 0.95) < 0.1
    assert evaluate(table, brdf)["energy_mean"] < 0.02


def test_channels_with_wavelengths_are_written_as_they_are(tmp_path):
    class Spectrum(Lambert):
        wavelengths = np.linspace(400, 700, 5)

    write_bsdf(Spectrum([0.1, 0.2, 0.3, 0.4, 0.5]), tmp_path / "x.bsdf", spectral=True, incidences=8)
    table = RglBrdf.from_file(tmp_path / "x.bsdf")
    n = np.array([[0.0, 0.0, 1.0]])
    np.testing.assert_allclose(table.eval(n, n)[0] * np.pi, [0.1, 0.2, 0.3, 0.4, 0.5], rtol=1e-3)
    np.testing.assert_allclose(table.wavelengths, Spectrum.wavelengths)


def test_upsampled_colours_are_the_colours():
    basis = upsample()
    np.testing.assert_allclose(rgb_response() @ basis, np.eye(3), atol=1e-3)
    np.testing.assert_allclose(basis.sum(1), 1, atol=1e-3)
    assert basis.min() >= 0


class Wrong(Lambert):
    def __init__(self, value):
        super().__init__([0.5, 0.5, 0.5])
        self.value = value

    def eval(self, wi, wo):
        f = super().eval(wi, wo)
        f[(wo[:, 2] < 0.5) & (wo[:, 2] > 0.4)] = self.value
        return f


@pytest.mark.parametrize("value, word", [(np.nan, "not finite"), (-1e-3, "negative"), (np.inf, "not finite")])
def test_refuses_and_writes_nothing(tmp_path, value, word):
    with pytest.raises(ExportError, match=word):
        write_bsdf(Wrong(value), tmp_path / "x.bsdf")
    assert list(tmp_path.iterdir()) == []


def test_refuses_wrong_channels(tmp_path):
    with pytest.raises(ExportError, match="channels"):
        write_bsdf(Lambert([0.5, 0.4]), tmp_path / "x.bsdf")
    assert not (tmp_path / "x.bsdf").exists()


def test_one_channel_is_grey(tmp_path):
    """All that a detector of one channel knows of colour."""
    write_bsdf(Lambert([0.5]), tmp_path / "x.bsdf", incidences=4, resolution=8)
    table = load_brdf(tmp_path / "x.bsdf")
    up = np.array([[0.0, 0.0, 1.0]])
    wo = np.array([[0.5, 0.0, np.sqrt(0.75)]])
    np.testing.assert_allclose(table.eval(up, wo), np.full((1, 3), 0.5 / np.pi), rtol=1e-2)


def test_the_test_of_refusal_would_see_a_table_with_nan():
    """Without the check the NaN would have reached the file: the reader finds it."""
    from gonio.brdf import BrdfFileError
    from gonio.export.bsdf import fields

    good = fields(Lambert([0.5] * 3), incidences=4, resolution=8)
    good["rgb"][0, 0, 0, 3, 3] = np.nan
    with pytest.raises(BrdfFileError, match="NaN"):
        RglBrdf(good)


def test_a_table_is_made_finer_where_the_usual_one_is_off(tmp_path, monkeypatch):
    from gonio.export import bsdf

    monkeypatch.setattr(bsdf, "FINER", (36, 72))
    shapes = []
    for brdf in (Lambert([0.3] * 3), Mixture([Lambert([0.1] * 3), Ggx(0.3, f0=[0.5] * 3)])):
        monkeypatch.setattr(bsdf, "ENOUGH", 0.01 if not shapes else 0.0)
        write_bsdf(brdf, tmp_path / "x.bsdf")
        shapes.append(read_tensor_file(tmp_path / "x.bsdf")["rgb"].shape)
    assert shapes == [(1, 32, 3, 64, 64), (1, 36, 3, 72, 72)]
    # a size that was asked for is what is made
    write_bsdf(brdf, tmp_path / "x.bsdf", resolution=64)
    assert read_tensor_file(tmp_path / "x.bsdf")["rgb"].shape == (1, 32, 3, 64, 64)
