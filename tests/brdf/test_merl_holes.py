"""Entries that a MERL table marks as not measured take their neighbours' values, in each channel by itself."""

import subprocess
import sys

import numpy as np
import pytest

from gonio.brdf import BrdfFileError, MerlBrdf
from gonio.brdf.tables.merl import SHAPE, filled, write_merl_table
from gonio.geometry import from_angles


@pytest.fixture
def ring():
    """A constant 0.3 with a ring of -1 in theta_h, in green also a ridge across phi_d's seam."""
    table = np.full((3, *SHAPE), 0.3)
    table[:, 20:30] = -1
    table[1, :, :, :4] = table[1, :, :, -4:] = -1
    return table


def pairs(n=20_000):
    rng = np.random.default_rng(0)
    return [from_angles(np.arcsin(np.sqrt(rng.random(n))), 2 * np.pi * rng.random(n)) for _ in range(2)]


def test_a_ring_in_a_constant_is_constant(ring):
    brdf = MerlBrdf(ring)
    assert np.allclose(brdf.eval(*pairs()), 0.3, rtol=1e-12)
    assert brdf.invalid_entries.tolist() == [(ring[c] < 0).sum() for c in range(3)]


def test_a_hole_in_one_channel_alone():
    table = np.full((3, *SHAPE), 0.3)
    table[2, 10:60, 10:60, 40:140] = -1
    assert np.allclose(MerlBrdf(table).eval(*pairs()), 0.3, rtol=1e-12)


def test_a_slope_goes_on_through_a_hole():
    theta_h = np.linspace(1, 2, SHAPE[0])[:, None, None] * np.ones(SHAPE)
    torn = theta_h.copy()
    torn[40:43] = -1
    assert np.abs(filled(torn) / theta_h - 1).max() < 0.005


def test_measured_entries_stay(ring):
    ring[0, 50, 50, 50] = 7.0
    assert filled(ring[0])[50, 50, 50] == 7.0
    whole = np.full((3, *SHAPE), 0.2)
    assert MerlBrdf(whole).invalid_entries.sum() == 0


def test_nothing_to_fill_from_is_refused(tmp_path):
    table = np.full((3, *SHAPE), 0.3)
    table[1] = -1
    write_merl_table(tmp_path / "a.binary", table)
    with pytest.raises(BrdfFileError, match="without a single valid entry"):
        MerlBrdf.from_file(tmp_path / "a.binary")


def test_the_list_of_materials_says_so(ring, tmp_path):
    write_merl_table(tmp_path / "ring.binary", ring)
    done = subprocess.run(
        [sys.executable, "-m", "gonio.cli", "materials"],
        env={"GONIO_MATERIALS": str(tmp_path), "PATH": ""}, capture_output=True, text=True,
    )  # fmt: skip
    (line,) = [x for x in done.stdout.splitlines() if x.startswith("ring")]
    assert f"{(ring < 0).sum()} entries not measured, filled from their neighbours" in line
