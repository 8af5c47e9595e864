"""Intervals in the tables: those of the BRDF, at the directions of each row."""

import csv
import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

from gonio.brdf.models.lambert import Lambert
from gonio.export.intervals import LEVELS, columns


class Told(Lambert):
    def std(self, wi, wo):
        return 0.1 * self.eval(wi, wo)

    def interval(self, wi, wo, level):
        f = self.eval(wi, wo)
        return (1 - level) * f, (1 + level) * f


def directions(shape):
    rng = np.random.default_rng(0)
    w = rng.normal(size=(2, *shape, 3))
    w[..., 2] = np.abs(w[..., 2])
    return w / np.linalg.norm(w, axis=-1, keepdims=True)


def test_columns_have_the_shape_of_the_pairs_and_the_brdfs_own_values():
    brdf = Told([0.3, 0.6])
    wi, wo = directions((4, 5))
    wi[1, 2] = np.nan
    found = dict(columns(brdf, wi, wo))
    kinds = ["brdf", "std", *(f"{end}{level}" for level in LEVELS for end in ("low", "high"))]
    assert set(found) == {f"{kind}_{c}" for kind in kinds for c in (0, 1)}
    for v in found.values():
        assert v.shape == (4, 5) and np.isnan(v[1, 2]) and np.isfinite(np.delete(v.ravel(), 7)).all()
    assert found["brdf_1"][0, 0] == pytest.approx(0.6 / np.pi)
    assert found["high95_0"][0, 0] == pytest.approx(1.95 * 0.3 / np.pi)
    for narrow, wide in pairwise(LEVELS):
        inside = found[f"low{wide}_0"] <= found[f"low{narrow}_0"]
        assert (inside | np.isnan(found["brdf_0"])).all()


def test_a_brdf_without_intervals_has_no_columns():
    wi, wo = directions((3,))
    assert dict(columns(Lambert(0.3), wi, wo)) == {} and dict(columns(None, wi, wo)) == {}


def gonio(*args):
    return subprocess.run([sys.executable, "-m", "gonio.cli", *map(str, args)], capture_output=True, text=True)


def table(folder):
    assert gonio("export", folder, "--format", "csv").returncode == 0
    with open(folder / "samples.csv") as file:
        return list(csv.DictReader(file))


def test_the_command_writes_them(tmp_path):
    folder = tmp_path / "run"
    args = ("--rig", "ideal", "--no-post", "--out", folder, "--set", "budget.measurements=60")
    assert gonio("acquire", "analytic_gloss", *args).returncode == 0
    assert "std_0" not in table(folder)[0]  # before there is a BRDF: the readings alone
    assert gonio("reconstruct", folder).returncode == 0
    rows = [r for r in table(folder) if r["f_1"]]  # without the steps that measured nothing
    inside = [float(r["low95_1"]) <= float(r["f_1"]) <= float(r["high95_1"]) for r in rows]
    assert len(rows) == 60 and np.mean(inside) > 0.8
    assert gonio("reconstruct", folder, "--model", "ggx").returncode == 0
    done = gonio("render", folder, "--band")
    assert done.returncode == 2 and "--model auto" in done.stderr


def test_a_band_is_rendered(tmp_path):
    pytest.importorskip("mitsuba", reason="mitsuba is in the render extra")
    from gonio.render.band import render_band

    lines = render_band(Told([0.5, 0.5, 0.5]), tmp_path, 24, 4)
    assert (tmp_path / "band.png").exists()
    widths = [float(line.split("band: ")[1].split(" %")[0]) for line in lines[:-1]]
    assert all(60 < w < 130 for w in widths), lines  # f between 0.05 and 1.95 times itself, and light sent twice
