"""Three channels are red, green and blue by their names, whatever their order."""

import json

import numpy as np
import pytest

import gonio
from gonio.brdf import Lambert
from gonio.brdf.models.mixture import Mixture
from gonio.config import Material
from gonio.export import ExportWarning
from gonio.export.colours import as_rgb, rgb_order
from gonio.run.exports import export_run

UP = np.array([[0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    "names, order",
    [(("R", "G", "B"), [0, 1, 2]), (("B", "G", "R"), [2, 1, 0]), (("green", "red", "blue"), [1, 0, 2]),
     (("450nm", "550 nm", "650"), [2, 1, 0]), (("Y",), [0]), (("a", "b"), [0, 1])],
)  # fmt: skip
def test_order(names, order):
    assert rgb_order(names) == order


def test_names_that_do_not_say_it_are_said():
    with pytest.warns(ExportWarning, match="channels c0, c1, c2 are written as red, green, blue, in this order"):
        assert rgb_order(("c0", "c1", "c2")) == [0, 1, 2]


def test_a_brdf_in_order():
    brdf = Mixture([Lambert([0.1, 0.2, 0.3])])
    assert as_rgb(brdf, ("R", "G", "B")) is brdf
    assert np.allclose(as_rgb(brdf, ("B", "G", "R")).eval(UP, UP) * np.pi, [[0.3, 0.2, 0.1]])


def test_exports_of_a_run_whose_channels_run_the_other_way(tmp_path):
    red = lambda wi, wo: np.tile([0.02, 0.05, 0.25], (len(wi), 1))  # of 450, 550 and 650 nm
    channels = ["450nm", "550nm", "650nm"]
    material = Material.model_validate({"name": "x", "channels": channels, "budget": {"measurements": 40}})
    run = gonio.acquire(material, gonio.open_rig("ideal", truth=red), tmp_path / "run")
    run.brdf("auto")
    from gonio.run.products import make_brdf

    make_brdf(run.folder)
    export_run(run.folder, "bsdf", tmp_path / "x.bsdf")
    f = gonio.load_brdf(tmp_path / "x.bsdf").eval(UP, UP)[0]
    assert np.allclose(f, [0.25, 0.05, 0.02], rtol=0.1)
    said = json.loads((export_run(run.folder, "gltf", tmp_path / "x.gltf")).read_text())
    colour = said["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"]
    assert colour[0] > 3 * colour[1] > 3 * colour[2]
