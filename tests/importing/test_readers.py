"""Every format's directions and values are what its own convention says, and come back as f of the BRDF they are of."""

import numpy as np
import pytest
from importing import files

from gonio.importing import CannotImport
from gonio.importing.delimited import Choices
from gonio.importing.formats import FORMATS, mapping_of, read, sniff
from gonio.importing.run import take


def opened(path, value=None, choices=Choices(), given=(), scale=None, symmetry=None):  # noqa: B008 - frozen
    kind = sniff(path)
    mapping = mapping_of(path, list(given)) if kind in ("csv", "parquet") else None
    return take(read([path], kind, mapping, choices), quantity=value, scale=scale, symmetry=symmetry)


@pytest.mark.parametrize("kind", files.TEXTS)
def test_values_where_the_format_says_they_are(kind, tmp_path):
    path = tmp_path / files.NAMES[kind]
    path.write_text(files.text_of(kind))
    assert sniff(path) == kind and kind in FORMATS
    t = opened(path)
    want = files.BRDF.eval(t.wi, t.wo) if len(t.channels) == 3 else files.GREY.eval(t.wi, t.wo)
    if kind == "json":
        assert t.channels == ("550nm", "650nm")
        want = want * np.array([1.0, 0.5])
        np.testing.assert_allclose(t.sigma, 0.02 * want, rtol=1e-6)
    # XYZ has four digits; SPEOS' scale is an integral over its grid
    np.testing.assert_allclose(t.f, want, rtol={"pab": 2e-3, "speos": 5e-3}.get(kind, 1e-4), atol=1e-4)
    assert len(t.f) > 100 and not t.doubts.lines


def test_parquet_as_pandas_writes_it(tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    theta_i, theta_o, phi_o = files.grid()
    wi, wo = files.pairs(theta_i, theta_o, phi_o)
    frame = pandas.DataFrame(
        {"theta_i": theta_i, "theta_r": theta_o, "phi": phi_o, "brdf": files.GREY.eval(wi, wo)[:, 0]}
    )
    frame.to_parquet(tmp_path / "x.parquet")
    t = opened(tmp_path / "x.parquet")
    np.testing.assert_allclose(t.f, files.GREY.eval(t.wi, t.wo), rtol=1e-9)


def test_merl_holes_are_left_out(tmp_path):
    files.merl(tmp_path / "x.binary")
    t = opened(tmp_path / "x.binary")
    assert 15_000 < len(t.f) < 25_000 and (t.f > 0).all()
    h = t.wi + t.wo
    theta_h = np.arccos(np.clip(h[:, 2] / np.linalg.norm(h, axis=1), -1, 1))
    want = np.where(theta_h < np.pi / 2 * (63 / 90) ** 2, 0.5, 0.25) / np.pi
    np.testing.assert_allclose(t.f, want[:, None] * np.ones(3), rtol=1e-9)
    assert any("never measured" in line for line in t.said)


@pytest.mark.parametrize(
    "head", ["#incident_angle 30 0\n", "#incident_angle: 30.0, 0.0\n", "#intheta 30\n", "# intheta 30\n# inphi 0\n"]
)
def test_headers_of_pab_as_they_are_met(head, tmp_path):
    (tmp_path / "x.txt").write_text(files.pab(head=head, form="BSDF"))
    t = opened(tmp_path / "x.txt")
    np.testing.assert_allclose(t.f, files.BRDF.eval(t.wi, t.wo), rtol=2e-3, atol=1e-4)


def test_a_folder_of_pab(tmp_path):
    for angle in (10, 50):
        (tmp_path / f"a{angle}.txt").write_text(files.pab(angle))
    t = opened(tmp_path)
    assert len({round(z, 6) for z in t.wi[:, 2]}) == 2
    (tmp_path / "b.txt").write_text(files.pab(20, form="BRDF"))
    with pytest.raises(CannotImport, match=r"b\.txt: another quantity"):
        opened(tmp_path)


def test_pab_without_a_format_needs_the_quantity(tmp_path):
    text = "\n".join(line for line in files.pab().split("\n") if not line.startswith("#format"))
    (tmp_path / "x.txt").write_text(text)
    with pytest.raises(CannotImport, match="--value"):
        opened(tmp_path / "x.txt")
    t = opened(tmp_path / "x.txt", value="f_cos")
    np.testing.assert_allclose(t.f, files.BRDF.eval(t.wi, t.wo), rtol=2e-3, atol=1e-4)


def test_older_brdf_json(tmp_path):
    names = ["theta_i", "phi_i", "theta_v", "phi_v", "BRDF"]
    rows = [[10, 0, 20, 180, 0.3], [10, 0, 20, 180, 0.5], [30, 0, 5, 90, 0.2]]
    variables = [{"name": n, "type": "number", "unit": "deg" if n != "BRDF" else "1/sr"} for n in names]
    import json

    (tmp_path / "x.json").write_text(json.dumps({"data": {"variables": variables, "values": rows}}))
    t = opened(tmp_path / "x.json")
    assert sorted(t.f[:, 0]) == [0.2, 0.4]  # two polarisations, their mean


def test_zemax_in_colour(tmp_path):
    text = files.zemax().replace("Monochrome", "XYZ", 1)
    head, body = text.split("Monochrome\nDataBegin\n")
    body = body.removesuffix("DataEnd\n")
    blocks = "".join(f"Tristimulus{c}\nDataBegin\n{body}DataEnd\n" for c in "XYZ")
    (tmp_path / "x.bsdf").write_text(head + blocks)
    t = opened(tmp_path / "x.bsdf")
    assert t.channels == ("R", "G", "B")
    np.testing.assert_allclose(t.f @ files.RGB_TO_XYZ.T, files.GREY.eval(t.wi, t.wo) * np.ones(3), rtol=2e-3)


@pytest.mark.parametrize(
    "kind, cut, says",
    [
        ("pab", "#intheta", "#intheta"),
        ("astm", "VARS", "VARS|column|header|first"),
        ("zemax", "TIS", "blocks|TIS"),
        ("lighttools", "DataBegin", "DataBegin"),
        ("json", "theta_r", "theta_r"),
        ("speos", "350", "number|expected"),
    ],
)
def test_what_is_missing_is_named(kind, cut, says, tmp_path):
    path = tmp_path / files.NAMES[kind]
    text = files.text_of(kind)
    if kind == "json":
        text = text.replace("theta_r", "theta_x")
    else:
        lines = text.split("\n")
        del lines[next(k for k, line in enumerate(lines) if line.startswith(cut))]
        text = "\n".join(lines)
    path.write_text(text)
    with pytest.raises(CannotImport, match=says):
        take(read([path], kind, None, Choices()), quantity=None, scale=None, symmetry=None)


def test_other_peoples_binaries_are_named(tmp_path):
    for data, says in ((b"tensor_file\0", "RGL"), (b"\x89HDF\r\n\x1a\n", "HDF5")):
        (tmp_path / "x.bsdf").write_bytes(data + bytes(100))
        with pytest.raises(CannotImport, match=says):
            sniff(tmp_path / "x.bsdf")
    (tmp_path / "x.csv").write_bytes("theta".encode("utf-16"))
    with pytest.raises(CannotImport, match="UTF-16"):
        opened(tmp_path / "x.csv")
