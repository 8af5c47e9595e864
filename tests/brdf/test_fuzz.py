"""Ten thousand damaged files for each reader: BrdfFileError or a BRDF, nothing else, quickly and in little memory."""

import io
import resource
import struct

import numpy as np
import pytest
from brdf.tables import isotropic_fields

from gonio.brdf import BrdfFileError, MerlBrdf, RglBrdf
from gonio.brdf.tables import merl as merl_module
from gonio.brdf.tables.tensor_file import write_tensor_file
from gonio.geometry import from_angles

CASES = 10_000
HUGE = [2**16 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63, 2**64 - 1]


def damage(good, header, rng):
    """One of: bytes changed (mostly in the header), cut, a huge number written, pieces swapped or grown."""
    b, kind = bytearray(good), rng.integers(6)
    if kind == 0:
        for _ in range(rng.integers(1, 6)):
            b[rng.integers(header)] = rng.integers(256)
    elif kind == 1:
        del b[rng.integers(len(b) if rng.random() < 0.5 else header) :]
    elif kind == 2:
        at = rng.integers(max(1, header - 8))
        b[at : at + 8] = struct.pack("<Q", HUGE[rng.integers(len(HUGE))])
    elif kind == 3:
        for _ in range(rng.integers(1, 20)):
            b[rng.integers(len(b))] = rng.integers(256)
    elif kind == 4:
        at, n = rng.integers(len(b)), rng.integers(1, 64)
        b[at : at + n] = bytes(rng.integers(0, 256, rng.integers(64), dtype=np.uint8))
    else:
        at = rng.integers(header)
        b[at:at] = bytes(rng.integers(1, 32))
    return bytes(b)


def check(read, data):
    """True where `read` refused, with one line; a BRDF that came out instead must give finite values."""
    try:
        brdf = read(io.BytesIO(data), "x")
    except BrdfFileError as e:
        assert "\n" not in str(e) and str(e).startswith("x")
        return True
    w = from_angles(np.linspace(0.1, 1.5, 8), np.linspace(0, 6, 8))
    assert np.isfinite(brdf.eval(w, w[::-1])).all()
    return False


def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def test_rgl_reader(tmp_path):
    write_tensor_file(tmp_path / "good", isotropic_fields(slices=2, n=4, m=3))
    good = (tmp_path / "good").read_bytes()
    header = good.index(b"synthetic")
    rng, before = np.random.default_rng(11), peak_mb()
    with np.errstate(all="ignore"):
        refused = sum(check(RglBrdf.from_file, damage(good, header, rng)) for _ in range(CASES))
    assert CASES / 2 < refused < CASES
    assert peak_mb() - before < 500
    assert not check(RglBrdf.from_file, good)


@pytest.mark.parametrize("at", range(0, 400, 7))
def test_rgl_reader_cut_at_every_kind_of_byte(tmp_path, at):
    write_tensor_file(tmp_path / "good", isotropic_fields(slices=2, n=4, m=3))
    with pytest.raises(BrdfFileError):
        RglBrdf.from_file(io.BytesIO((tmp_path / "good").read_bytes()[:at]), "x")


def test_merl_reader(monkeypatch):
    """With tables of 3 x 3 x 6 bins: a real one has 35 MB, and its size is all that the reader takes from it."""
    monkeypatch.setattr(merl_module, "SHAPE", (3, 3, 6))
    monkeypatch.setattr(merl_module, "SIZE", 12 + 3 * 8 * 54)
    rng, before = np.random.default_rng(12), peak_mb()
    good = np.array([3, 3, 6], "<i4").tobytes() + rng.random((3, 3, 3, 6)).astype("<f8").tobytes()

    def read(stream, name):
        merl_module.read_merl(stream, name)

    refused = 0
    for _ in range(CASES):
        try:
            read(io.BytesIO(damage(good, 12, rng)), "x")
        except BrdfFileError as e:
            assert "\n" not in str(e) and str(e).startswith("x")
            refused += 1
    assert CASES / 2 < refused < CASES
    assert peak_mb() - before < 500
    read(io.BytesIO(good), "x")


@pytest.mark.parametrize("dims", [(90, 90, 180), (2**31 - 1,) * 3, (-1, -1, -1), (180, 90, 90), (3, 3, 6)])
def test_merl_sizes_that_lie(dims):
    with pytest.raises(BrdfFileError):
        MerlBrdf.from_file(io.BytesIO(np.array(dims, "<i4").tobytes() + bytes(1000)), "x")
