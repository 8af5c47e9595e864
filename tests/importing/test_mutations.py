"""Damaged files of every format: one line or readings, nothing else, in little memory.

`GONIO_MUTATIONS=10000 pytest tests/importing/test_mutations.py` tries as many of each reader.
"""

import io
import os
import resource

import numpy as np
import pytest
from brdf.test_fuzz import damage
from importing import files

from gonio.brdf.tables import merl as merl_table
from gonio.importing import CannotImport, merl
from gonio.importing.delimited import Choices
from gonio.importing.formats import mapping_of, read
from gonio.importing.run import take

CASES = int(os.environ.get("GONIO_MUTATIONS", "300"))
WORDS = [
    "nan",
    "inf",
    "-inf",
    "1e999",
    "-1",
    "0",
    "99999999999",
    "1e300",
    "",
    "x",
    "°",
    "1,5",
    "{",
    "[[[[",
    '"',
    "\x00",
]


def damaged(text: str, rng) -> bytes:
    """A word, a line or some bytes of a text wrong, missing or too many."""
    kind = rng.integers(5)
    if kind == 0:
        return damage(text.encode(), min(len(text), 400), rng)
    lines = text.split("\n")
    at = int(rng.integers(len(lines) if rng.random() < 0.5 else min(len(lines), 12)))
    if kind == 1:
        words = lines[at].split(" ") if " " in lines[at] else lines[at].split(",")
        words[rng.integers(len(words))] = WORDS[rng.integers(len(WORDS))]
        lines[at] = ("," if "," in lines[at] else " ").join(words)
    elif kind == 2:
        del lines[at : at + int(rng.integers(1, 6))]
    elif kind == 3:
        lines[at:at] = lines[at : at + 1] * int(rng.integers(1, 40))
    else:
        return text.encode()[: int(rng.integers(len(text.encode())))]
    return "\n".join(lines).encode()


def survived(path, kind, whole) -> bool:
    """True where it was refused, in one line."""
    try:
        mapping = mapping_of(path, []) if kind in ("csv", "parquet") else None
        readings = read([path], kind, mapping, Choices())
        assert len(readings.wi) == len(readings.wo) == len(readings.value)
        assert readings.value.shape[1] == len(readings.channels)
        if whole:
            t = take(readings, quantity="f", scale=None, symmetry="isotropic")
            assert np.isfinite(t.f).all() and np.isfinite(t.wi).all() and (t.sigma >= 0).all()
    except CannotImport as e:
        assert "\n" not in str(e) and str(e).startswith((str(path), "none of", "values up", "what the values"))
        return True
    return False


@pytest.mark.parametrize("kind", files.TEXTS)
def test_texts(kind, tmp_path):
    good = files.text_of(kind)
    if kind == "speos":  # a small one: all of it is read again and again
        good = "\n".join(good.split("\n")[:120])
    rng, before = np.random.default_rng(21), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    path = tmp_path / files.NAMES[kind]
    refused = 0
    with np.errstate(all="ignore"):
        for k in range(CASES):
            path.write_bytes(damaged(good, rng))
            refused += survived(path, kind, whole=k % 20 == 0)
    assert CASES / 5 < refused <= CASES
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024 < 500


def test_parquet(tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    buffer = io.BytesIO()
    pandas.DataFrame({name: np.linspace(0, 80, 50) for name in files.OWN}).to_parquet(buffer)
    good = buffer.getvalue()
    rng, refused = np.random.default_rng(22), 0
    path = tmp_path / "x.parquet"
    with np.errstate(all="ignore"):
        for k in range(CASES):
            path.write_bytes(damage(good, len(good), rng))
            refused += survived(path, "parquet", whole=k % 20 == 0)
    assert CASES / 5 < refused <= CASES


def test_merl(tmp_path, monkeypatch):
    """With tables of 3 x 3 x 6 bins, as the table's own reader is tried."""
    for module in (merl_table, merl):
        monkeypatch.setattr(module, "SHAPE", (3, 3, 6))
        monkeypatch.setattr(module, "SIZE", 12 + 3 * 8 * 54)
    rng, refused = np.random.default_rng(23), 0
    good = np.array([3, 3, 6], "<i4").tobytes() + rng.random((3, 54)).astype("<f8").tobytes()
    path = tmp_path / "x.binary"
    with np.errstate(all="ignore"):
        for k in range(CASES):
            path.write_bytes(damage(good, 12, rng))
            refused += survived(path, "merl", whole=k % 20 == 0)
    assert CASES / 5 < refused <= CASES
    path.write_bytes(good)
    assert not survived(path, "merl", whole=True)


@pytest.mark.parametrize(
    "text, says",
    [
        ("theta_i,theta_o,phi,f\n" + "1\n" * 1_600_000, "lines"),
        ("1 " * 1_100_000, "characters"),
        ("1 2 3 4 5\n" + "1" * 2_100_000, "characters"),
    ],
)
def test_texts_out_of_measure_are_not_taken_apart(text, says, tmp_path):
    path, before = tmp_path / "x.csv", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    path.write_text(text)
    with pytest.raises(CannotImport, match=says):
        mapping_of(path, [])
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024 < 200


def test_counts_that_lie_cost_nothing(tmp_path):
    path, before = tmp_path / "x.bsdf", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for text in (
        files.zemax().replace("ScatterRadial 6", "ScatterRadial 99999"),
        files.zemax().replace("TIS 0.5\n", "", 1),
    ):
        path.write_text(text)
        with pytest.raises(CannotImport):
            read([path], "zemax", None, Choices())
    assert (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024 < 100
