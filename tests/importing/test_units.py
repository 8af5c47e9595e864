"""What the names of columns say of their units, and rows that say they are saturated."""

import json

import numpy as np
import pytest
from importing import files
from importing.test_columns import written
from importing.test_readers import opened

from gonio.importing import CannotImport


def columns():
    theta_i, theta_o, phi = files.grid()
    wi, wo = files.pairs(theta_i, theta_o, phi)
    return theta_i, theta_o, phi, files.GREY.eval(wi, wo)[:, 0]


@pytest.mark.parametrize("words", [("0", "1"), ("False", "True")])
@pytest.mark.parametrize("names", [files.OWN[:5], ["theta_i", "phi_i", "theta_o", "phi_o", "brdf"]])
def test_saturated_rows_are_left_out(names, words, tmp_path):
    theta_i, theta_o, phi, f = columns()
    rows = [f"{a},0,{b},{c},{v:.9g},{words[k < 12]}" for k, (a, b, c, v) in enumerate(zip(theta_i, theta_o, phi, f))]
    (tmp_path / "x.csv").write_text("\n".join([",".join([*names, "saturated"]), *rows]))
    t = opened(tmp_path / "x.csv")
    assert len(t.f) == len(f) - 12 and f"12 of {len(f)} readings are saturated and are left out" in t.said


def test_saturated_rows_of_parquet(tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    theta_i, theta_o, phi, f = columns()
    frame = pandas.DataFrame(dict(zip([*files.OWN[:5], "saturated"], [theta_i, 0 * phi, theta_o, phi, f, f > 0.5])))
    frame.to_parquet(tmp_path / "x.parquet")
    t = opened(tmp_path / "x.parquet")
    assert len(t.f) == (f <= 0.5).sum() < len(f)


def test_each_angle_in_its_own_unit(tmp_path):
    theta_i, theta_o, phi, f = columns()
    t = opened(
        written(tmp_path, ["theta_i_deg", "theta_o [deg]", "phi_rad", "f"], [theta_i, theta_o, np.radians(phi), f])
    )
    np.testing.assert_allclose(t.f, files.GREY.eval(t.wi, t.wo), rtol=1e-6)


def test_per_cent(tmp_path):
    theta_i, theta_o, phi, f = columns()
    names = ["theta_i", "theta_o", "phi", "BRDF [%]", "std [%]"]
    t = opened(written(tmp_path, names, [theta_i, theta_o, phi, 100 * f, 0 * f + 3]))
    np.testing.assert_allclose(t.f, files.GREY.eval(t.wi, t.wo), rtol=1e-6)
    np.testing.assert_allclose(t.sigma, 0.03 * t.f, rtol=1e-6)
    assert sum("BRDF [%]" in line for line in t.said) == 2
    t = opened(written(tmp_path, [*names[:3], "reflectance (%)", "std"], [theta_i, theta_o, phi, 50 * f, 2 * f]))
    np.testing.assert_allclose(t.sigma, 0.04 * t.f, rtol=1e-6)


def test_other_units_are_refused_but_of_counts(tmp_path):
    data = columns()
    with pytest.raises(CannotImport, match=r"BRDF \[W\]: unit 'W'"):
        opened(written(tmp_path, ["theta_i", "theta_o", "phi", "BRDF [W]"], data))
    for name in ("BRDF [sr^-1]", "BRDF [-]", "BRDF []", "BRDF (sr-1)", "550 [nm]"):
        assert len(opened(written(tmp_path, ["theta_i", "theta_o", "phi", name], data), value="f").f)
    assert len(opened(written(tmp_path, ["theta_i", "theta_o", "phi", "signal [mV]"], data), scale=1.0).f)


@pytest.mark.parametrize("names", ["brdf_x brdf_y brdf_z", "BRDF_Z BRDF_X BRDF_Y", "Z X Y"])
def test_tristimulus_values_in_any_case_and_order(names, tmp_path):
    theta_i, theta_o, phi, _ = columns()
    wi, wo = files.pairs(theta_i, theta_o, phi)
    xyz = dict(zip("xyz", (files.BRDF.eval(wi, wo) @ files.RGB_TO_XYZ.T).T))
    data = [theta_i, theta_o, phi, *(xyz[n[-1].lower()] for n in names.split())]
    t = opened(written(tmp_path, ["theta_i", "theta_o", "phi", *names.split()], data), value="f")
    assert t.channels == ("R", "G", "B")
    np.testing.assert_allclose(t.f, files.BRDF.eval(t.wi, t.wo), rtol=2e-3, atol=2e-4)


def json_with(tmp_path, **units):
    """The BRDF-JSON of `files` with other units (and values to match, where given)."""
    whole = json.loads(files.brdf_json())
    for key, (unit, factor) in units.items():
        item = whole["data"][key]
        item["unit"], item["values"] = unit, [v * factor for v in item["values"]]
    (tmp_path / "x.brdf").write_text(json.dumps(whole))
    return opened(tmp_path / "x.brdf")


@pytest.mark.parametrize("unit", ["relative", "1", "%"])
def test_relative_uncertainty_in_brdf_json(unit, tmp_path):
    t = json_with(tmp_path, uBRDF=(unit, 1.0 if unit == "%" else 0.01), BRDF=("%", 100.0))
    np.testing.assert_allclose(t.f, files.GREY.eval(t.wi, t.wo) * [1.0, 0.5], rtol=1e-6)
    np.testing.assert_allclose(t.sigma, 0.02 * t.f, rtol=1e-6)
    assert any("per cent" in line for line in t.said)


@pytest.mark.parametrize("unit, factor", [("m", 1e-9), ("µm", 1e-3), ("μm", 1e-3), ("Å", 10), ("nm", 1)])
def test_wavelengths_in_brdf_json(unit, factor, tmp_path):
    assert json_with(tmp_path, wavelength_i=(unit, factor)).channels == ("550nm", "650nm")


@pytest.mark.parametrize("key", ["BRDF", "uBRDF", "wavelength_i"])
def test_other_units_in_brdf_json_are_refused(key, tmp_path):
    with pytest.raises(CannotImport, match=rf"data\.{key}\.unit: 'furlong'"):
        json_with(tmp_path, **{key: ("furlong", 1)})
