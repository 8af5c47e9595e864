"""Opening and saving BRDFs."""

import numpy as np
import pytest
from brdf.tables import isotropic_fields

import gonio
from gonio.brdf import Abc, Beckmann, BrdfFileError, Ggx, Lambert, MerlBrdf, Mixture, NetworkBrdf, RglBrdf
from gonio.brdf.models.student import Student
from gonio.brdf.tables.merl import SHAPE, write_merl_table
from gonio.brdf.tables.tensor_file import write_tensor_file
from gonio.geometry import from_angles
from gonio.load import save_brdf


def pairs(n=500, seed=0):
    rng = np.random.default_rng(seed)
    return [from_angles(np.arccos(rng.random(n)), 2 * np.pi * rng.random(n)) for _ in range(2)]


@pytest.mark.parametrize(
    "brdf",
    [
        Lambert([0.1, 0.2]),
        Ggx(0.1, 0.2, f0=[0.5, 0.6, 0.7], weight=0.9),
        Ggx(0.1, eta=[0.2, 0.9, 1.1], k=[3, 2.5, 2.0]),
        Beckmann(0.3),
        Student(0.1, 0.2, [0.5, 0.6, 0.7], gamma=1.7),
        Abc([0.1, 0.2], 3.0, 100.0, 1.5, 1.4),
        Mixture([Lambert(0.3), Mixture([Ggx(0.1), Beckmann(0.2)])], [1, 2]),
        RglBrdf(isotropic_fields(n=16)),
    ],
    ids=lambda b: b.kind,
)
def test_saved_and_opened_again(brdf, tmp_path):
    save_brdf(brdf, tmp_path / "brdf.npz")
    wi, wo = pairs()
    for path in (tmp_path / "brdf.npz", tmp_path):  # the file, and the run folder it lies in
        back = gonio.load_brdf(path)
        assert type(back) is type(brdf) and back.channels == brdf.channels
        np.testing.assert_array_equal(back.eval(wi, wo), brdf.eval(wi, wo))
        np.testing.assert_array_equal(back.pdf(wi, wo), brdf.pdf(wi, wo))


def test_formats_by_suffix(tmp_path):
    write_tensor_file(tmp_path / "a_rgb.bsdf", isotropic_fields(n=16))
    write_merl_table(tmp_path / "b.binary", np.random.default_rng(0).random((3, *SHAPE)))
    np.savez(tmp_path / "n.npz", names=["x", "y"], weights=np.zeros((2, 675), np.float32))
    assert isinstance(gonio.load_brdf(tmp_path / "a_rgb.bsdf"), RglBrdf)
    assert isinstance(gonio.load_brdf(tmp_path / "b.binary"), MerlBrdf)
    assert isinstance(gonio.load_brdf(f"{tmp_path}/n.npz:y"), NetworkBrdf)
    with pytest.raises(BrdfFileError, match="no network 'z'"):
        gonio.load_brdf(f"{tmp_path}/n.npz:z")


def test_merl_round_trip_and_nearest_bin(tmp_path, monkeypatch):
    table = np.random.default_rng(0).random((3, *SHAPE))
    write_merl_table(tmp_path / "b.binary", table)
    wi, wo = pairs()
    np.testing.assert_allclose(
        MerlBrdf.from_file(tmp_path / "b.binary").eval(wi, wo), MerlBrdf(table).eval(wi, wo), rtol=1e-12
    )


def test_merl_agrees_with_the_referee(tmp_path, score):
    write_merl_table(tmp_path / "b.binary", np.random.default_rng(0).random((3, *SHAPE)))
    wi, wo = pairs(5000)
    ours, theirs = (
        MerlBrdf.from_file(tmp_path / "b.binary").eval(wi, wo),
        score.Merl(tmp_path / "b.binary").eval(wi, wo),
    )
    differ = np.any(np.abs(ours - theirs) > 1e-5 * np.abs(theirs), axis=1)
    assert differ.sum() <= 2  # pairs within rounding of a bin's edge


def test_bad_files_say_one_line(tmp_path):
    wrong = {
        "nothing.npz": b"",
        "text.npz": b"hello",
        "text.bsdf": b"hello" * 10,
        "text.binary": b"hello" * 10,
        "x.png": b"?",
    }
    for name, content in wrong.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(BrdfFileError) as e:
            gonio.load_brdf(tmp_path / name)
        assert "\n" not in str(e.value) and name in str(e.value)
    (tmp_path / "run").mkdir()
    with pytest.raises(BrdfFileError, match=r"no brdf\.npz"):
        gonio.load_brdf(tmp_path / "run")


def test_saved_files_that_cannot_be_opened(tmp_path):
    path = tmp_path / "b.npz"
    np.savez(path, kind="from_the_future", format_version=1)
    with pytest.raises(BrdfFileError, match="unknown kind"):
        gonio.load_brdf(path)
    np.savez(path, kind="ggx", format_version=99)
    with pytest.raises(BrdfFileError, match="format 99"):
        gonio.load_brdf(path)
    np.savez(path, kind="ggx", format_version=1)
    with pytest.raises(BrdfFileError, match="wrong or missing arrays"):
        gonio.load_brdf(path)
    np.savez(path, kind=np.array([object()], dtype=object), format_version=1)  # a pickle is never opened
    with pytest.raises(BrdfFileError, match="not a saved BRDF"):
        gonio.load_brdf(path)


def test_a_failed_save_leaves_the_old_file(tmp_path):
    save_brdf(Lambert(0.5), tmp_path / "b.npz")

    class Broken(Lambert):
        def to_arrays(self):
            return {"albedo": self.albedo, "odd": np.array([object()])}

    with pytest.raises(ValueError):
        save_brdf(Broken(0.1), tmp_path / "b.npz")
    assert [p.name for p in tmp_path.iterdir()] == ["b.npz"]
    assert gonio.load_brdf(tmp_path / "b.npz").albedo[0] == 0.5
