"""Columns of a table: guessed from headers as laboratories write them, said by hand, refused where not clear."""

import numpy as np
import pytest
from importing import files
from importing.test_readers import opened

from gonio.importing import CannotImport
from gonio.importing.delimited import Choices
from gonio.importing.roles import guess

HEADERS = {
    "theta_i theta_r phi brdf": "theta_i theta_o phi f",
    "Theta_i [deg]|Phi_i [deg]|Theta_r [deg]|Phi_r [deg]|BRDF": "theta_i phi_i theta_o phi_o f",
    "AOI|Scatter Angle|Azimuth|BSDF": "theta_i theta_o phi f",
    "thetaIn phiIn thetaOut phiOut R G B": "theta_i phi_i theta_o phi_o f f f",
    "SZA SAA VZA VAA reflectance": "theta_i phi_i theta_o phi_o f",
    "theta_h phi_h theta_d phi_d fr": "theta_h phi_h theta_d phi_d f",
    "theta_i phi_i theta_d phi_d signal": "theta_i phi_i theta_o phi_o f",
    "wi_x wi_y wi_z wo_x wo_y wo_z 450nm 550nm": "wi_x wi_y wi_z wo_x wo_y wo_z f f",
    "incidence_angle|view_angle|relative_azimuth|BRF|std": "theta_i theta_o phi f sigma",
    "theta_i theta_o phi f_R f_G sigma_R sigma_G comment": "theta_i theta_o phi f f sigma sigma -",
    "θi|θr|Δφ|BRDF [1/sr]": "theta_i theta_o phi f",
}


@pytest.mark.parametrize("header", HEADERS)
def test_headers(header):
    names = header.split("|") if "|" in header else header.split()
    mapping = guess(names)
    assert [c.role for c in mapping.columns] == HEADERS[header].split()
    assert mapping.guessed


def test_quantities_by_their_names():
    for name, quantity in (
        ("BRDF", "f"),
        ("DSF", "f_cos"),
        ("brdf_cos", "f_cos"),
        ("BRF", "factor"),
        ("counts", "counts"),
    ):
        assert guess(["theta_i", "theta_o", "phi", name]).quantity == quantity
    assert guess(["theta_i", "theta_o", "phi", "X", "Y", "Z"]).quantity is None


def test_gonios_own_names_are_no_guess():
    names = [*files.OWN, "sigma_R", "sigma_G", "sigma_B", "brdf_0", "std_0"]
    mapping = guess(names)
    assert not mapping.guessed and mapping.quantity == "f" and mapping.unit == "degrees"
    assert [c.role for c in mapping.columns[-2:]] == ["-", "-"]


def written(tmp_path, names, columns, separator=","):
    path = tmp_path / "x.csv"
    path.write_text(files.table(names, columns, separator))
    return path


def test_half_and_difference_angles(tmp_path):
    theta_h, theta_d, phi_d = (a.ravel() for a in np.meshgrid([5, 20, 40.0], [5, 30, 50.0], np.arange(0, 180, 20.0)))
    from gonio.geometry import from_half_diff

    wi, wo = from_half_diff(*np.radians([theta_h, 0 * theta_h, theta_d, phi_d]))
    up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    f = np.where(up, files.GREY.eval(wi, wo)[:, 0], 0)
    t = opened(written(tmp_path, ["theta_h_deg", "phi_h_deg", "theta_d_deg", "phi_d_deg", "f"],
                       [theta_h, 0 * theta_h, theta_d, phi_d, f]))  # fmt: skip
    np.testing.assert_allclose(t.f, files.GREY.eval(t.wi, t.wo), rtol=1e-6)


def test_vectors_need_not_be_unit(tmp_path):
    wi, wo = files.pairs(*files.grid())
    f = files.GREY.eval(wi, wo)[:, 0]
    path = written(tmp_path, "wi_x wi_y wi_z wo_x wo_y wo_z f".split(), [*(3 * wi).T, *wo.T, f])
    t = opened(path)
    np.testing.assert_allclose(t.f, files.GREY.eval(t.wi, t.wo), rtol=1e-6)


@pytest.mark.parametrize("specular", [0, 180])
def test_the_mirror_direction_at_either_azimuth(specular, tmp_path):
    theta_i, theta_o, phi = files.grid()
    wi, wo = files.pairs(theta_i, theta_o, phi + 180 - specular)
    path = written(tmp_path, ["theta_i", "theta_o", "phi", "f"], [theta_i, theta_o, phi, files.GREY.eval(wi, wo)[:, 0]])
    t = opened(path, choices=Choices(None, float(specular)))
    np.testing.assert_allclose(t.f, files.GREY.eval(t.wi, t.wo), rtol=1e-6)
    wrong = opened(path, choices=Choices(None, float(180 - specular)))
    assert "--specular" in wrong.doubts.lines[0]


def test_a_scan_in_the_plane(tmp_path):
    theta_i, theta_o = (a.ravel() for a in np.meshgrid([20, 40, 60.0], np.arange(-80, 81, 5.0)))
    wi, wo = files.pairs(theta_i, np.abs(theta_o), np.where(theta_o > 0, 180.0, 0.0))
    t = opened(written(tmp_path, ["AOI", "theta_r", "BRDF"], [theta_i, theta_o, files.GREY.eval(wi, wo)[:, 0]]))
    np.testing.assert_allclose(t.f, files.GREY.eval(t.wi, t.wo), rtol=1e-6)
    assert any("one plane" in line for line in t.said) and not t.doubts.lines


@pytest.mark.parametrize("quantity", ["f", "f_cos", "factor", "counts"])
def test_quantities(quantity, tmp_path):
    theta_i, theta_o, phi = files.grid()
    wi, wo = files.pairs(theta_i, theta_o, phi)
    f, cos = files.GREY.eval(wi, wo)[:, 0], wo[:, 2]
    value = {"f": f, "f_cos": f * cos, "factor": np.pi * f, "counts": f * cos / 0.002}[quantity]
    path = written(tmp_path, ["theta_i", "theta_o", "phi", "v"], [theta_i, theta_o, phi, value])
    t = opened(path, value=quantity, given=["v=f"], scale=0.002 if quantity == "counts" else None)
    np.testing.assert_allclose(t.f, files.GREY.eval(t.wi, t.wo), rtol=1e-6)
    assert not t.doubts.lines
    if quantity == "counts":
        with pytest.raises(CannotImport, match="--scale"):
            opened(path, value="counts", given=["v=f"])


def test_semicolons_decimal_commas_comments_and_latin1(tmp_path):
    text = "# ein Kommentar: 5\xb0\ntheta_i;theta_o;phi;f\n10,5;20;180;0,25\n\n10,5;30;180;0,5\n"
    (tmp_path / "x.csv").write_bytes(text.encode("latin-1"))
    t = opened(tmp_path / "x.csv")
    assert t.f[:, 0].tolist() == [0.25, 0.5]
    assert np.allclose(np.degrees(np.arccos(t.wi[:, 2])), 10.5)


@pytest.mark.parametrize(
    "text, says",
    [
        ("theta_i,theta_o,phi,f\n1,2,3,0.1\n1,2,0.1\n", r"x\.csv:3: 3 fields, 4 expected"),
        ("theta_i,theta_o,phi,f\n1,2,3,0.1\n1,2,3,over\n", r"x\.csv:3: f: 'over' where a number"),
        ("theta_i,theta_o,phi\n1,2,3\n", "no column is taken as a value"),
        ("theta_i,phi,f\n1,2,3\n", "no column is taken as theta_o"),
        ("theta_i,AOI,theta_o,phi,f\n1,2,3,4,5\n", "theta_i and AOI are both"),
        ("theta_i,theta_i,f\n1,2,3\n", "two columns are named"),
        ("theta_i,theta_o,phi,f\n", "no rows"),
        ("theta_i,theta_o,phi,f\n1,2,3,\n", "none of 1 readings is usable"),
        ("", "empty"),
    ],
)
def test_refusals_say_where(text, says, tmp_path):
    (tmp_path / "x.csv").write_text(text)
    with pytest.raises(CannotImport, match=says):
        opened(tmp_path / "x.csv")


def test_by_hand(tmp_path):
    path = written(tmp_path, ["a", "b", "c", "d"], [[10.0, 20], [30.0, 40], [180.0, 180], [0.1, 0.2]])
    t = opened(path, given=["a=theta_i", "b=theta_o", "c=phi", "d=factor:grey"])
    assert t.channels == ("grey",) and t.quantity == "factor"
    np.testing.assert_allclose(t.f[:, 0], np.array([0.1, 0.2]) / np.pi)
    for wrong in ("e=theta_i", "a=theta_q", "a"):
        with pytest.raises(CannotImport, match="--column"):
            opened(path, given=[wrong])
