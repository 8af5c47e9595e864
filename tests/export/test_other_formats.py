"""MERL tables, the thesis's grids and pab text hold what the BRDF says."""

import numpy as np
import pytest
from brdf.halfsquare import sample_p_value

import gonio
from gonio.brdf import Ggx, Lambert, Mixture, RglBrdf
from gonio.evaluate import evaluate
from gonio.export import ExportError
from gonio.export.grid import write_grid
from gonio.export.merl import write_merl
from gonio.export.mountain import write_mountain
from gonio.geometry import from_angles

BRDF = Mixture([Lambert([0.1, 0.2, 0.3]), Ggx(0.2, f0=[0.5, 0.4, 0.3])], [0.3, 0.7])


def test_merl(tmp_path):
    write_merl(BRDF, tmp_path / "x.binary")
    assert (tmp_path / "x.binary").stat().st_size == 12 + 8 * 3 * 90 * 90 * 180
    figures = evaluate(gonio.load_brdf(tmp_path / "x.binary"), BRDF)
    # the bins of a lobe 11 degrees wide are read by the nearest: 1.6 % is what that leaves
    assert figures["energy_median"] < 0.02 and figures["energy_mean"] < 0.03
    assert 0.98 < figures["bright_min"] < figures["bright_max"] < 1.02


def test_thesis_grids(tmp_path):
    write_grid(BRDF, tmp_path / "grid.npz")
    brdf = gonio.load_brdf(tmp_path / "grid.npz")
    figures = evaluate(brdf, BRDF)
    assert figures["energy_median"] < 0.01 and 0.98 < figures["bright_min"] < figures["bright_max"] < 1.02
    assert sample_p_value(brdf, from_angles(0.8, 0.2), 0.2) > 1e-4


def test_thesis_grids_of_chrome(tmp_path, rgl_dir):
    truth = RglBrdf.from_file(rgl_dir / "chm_orange_rgb.bsdf")
    write_grid(truth, tmp_path / "grid.npz")
    assert evaluate(gonio.load_brdf(tmp_path / "grid.npz"), truth)["energy_median"] < 0.03


def read_pab(path):
    head = dict(line[1:].split(None, 1) for line in path.read_text().splitlines() if line.startswith("#"))
    return head, np.loadtxt(path)


def test_pab_text(tmp_path):
    grey = Ggx(0.05, f0=0.5)
    paths = write_mountain(grey, tmp_path / "m", theta_i_deg=(0, 45), name="grey")
    assert [p.name for p in paths] == ["grey_00.0.txt", "grey_45.0.txt"]
    head, table = read_pab(paths[1])
    assert head["format:"] == "theta phi DSF" and head["colorimetry:"] == "CIE-Y"
    assert float(head["intheta"]) == 45 and float(head["inphi"]) == 0
    wo = from_angles(np.radians(table[:, 0]), np.radians(table[:, 1]))
    wi = np.broadcast_to(from_angles(np.radians(45), 0.0), wo.shape)
    want = grey.eval(wi, wo)[:, 0] * wo[:, 2]
    np.testing.assert_allclose(table[:, 2], want, rtol=1e-3, atol=1e-6)  # angles are rounded to 1e-6 degrees
    assert np.sum(want > 0.5 * want.max()) > 200  # the lobe is well covered


def test_pab_text_in_colour_is_xyz(tmp_path):
    head, table = read_pab(write_mountain(Lambert([1.0, 1.0, 1.0]), tmp_path, theta_i_deg=(30,))[0])
    assert head["colorimetry:"] == "CIE-XYZ" and table.shape[1] == 5
    np.testing.assert_allclose(table[:, 3], np.cos(np.radians(table[:, 0])) / np.pi, rtol=1e-3)  # Y of white


def test_refusals(tmp_path):
    with pytest.raises(ExportError, match="ascending"):
        write_mountain(BRDF, tmp_path / "m", theta_i_deg=(30, 10))
    with pytest.raises(ExportError, match="channels"):
        write_merl(Lambert(0.5), tmp_path / "x.binary")

    class Negative(Lambert):
        def eval(self, wi, wo):
            return super().eval(wi, wo) - 0.1

    for write in (write_merl, write_grid, write_mountain):
        with pytest.raises(ExportError, match="negative"):
            write(Negative([0.1, 0.2, 0.3]), tmp_path / "wrong")
    assert list(tmp_path.iterdir()) == []
