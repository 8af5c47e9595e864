"""glTF and MaterialX by the libraries of their makers, Radiance's XML by Radiance's own rtrace."""

import json
import warnings

import numpy as np
import pytest

from gonio.brdf import Ggx, Lambert, Mixture
from gonio.brdf.models.student import Student
from gonio.evaluate import evaluate
from gonio.export import ExportError, ExportWarning
from gonio.export.extra import MissingExtra
from gonio.export.renderers.gltf import GltfBrdf, write_gltf
from gonio.export.renderers.lobes import Lobes
from gonio.export.renderers.materialx import write_materialx
from gonio.export.renderers.radiance import Tools, _lost_to_patches, _patch, write_klems, write_ttree
from gonio.geometry import from_angles

GLOSS = Mixture([Lambert([0.1, 0.2, 0.3]), Ggx(0.2, f0=[0.05, 0.05, 0.05])])
METAL = Mixture([Lambert([0.0, 0.0, 0.0]), Ggx(0.3, f0=[0.9, 0.6, 0.3])])


def test_lobes_of_other_tails_keep_their_width():
    wide = Lobes.of(Mixture([Lambert([0.1, 0.1, 0.1]), Student(0.1, f0=[0.5, 0.5, 0.5], gamma=4.0)]))
    half = lambda brdf, t: brdf.eval(from_angles(t, np.zeros_like(t)), from_angles(t, np.full_like(t, 0.0)))[:, 0]
    want = Student(0.1, f0=[0.5, 0.5, 0.5], gamma=4.0)
    t = np.array([0.0, np.arctan(0.1 * np.sqrt(2**0.25 - 1))])
    for made in (want, wide.brdf().parts[1]):
        falls = half(made, t)
        assert abs(falls[1] / falls[0] * np.cos(t[1]) ** 2 - 0.5) < 0.02


def test_gltf(tmp_path):
    with pytest.warns(ExportWarning, match="glTF"):
        write_gltf(GLOSS, tmp_path / "x.gltf", GLOSS)
    pbr = json.loads((tmp_path / "x.gltf").read_text())["materials"][0]["pbrMetallicRoughness"]
    assert pbr["metallicFactor"] == 0 and abs(pbr["roughnessFactor"] - np.sqrt(0.2)) < 0.03
    np.testing.assert_allclose(pbr["baseColorFactor"], [0.105, 0.21, 0.315, 1], atol=0.03)
    write_gltf(METAL, tmp_path / "metal.gltf")
    pbr = json.loads((tmp_path / "metal.gltf").read_text())["materials"][0]["pbrMetallicRoughness"]
    assert pbr["metallicFactor"] == 1
    np.testing.assert_allclose(pbr["baseColorFactor"], [0.9, 0.6, 0.3, 1], atol=0.02)
    made = GltfBrdf(pbr["roughnessFactor"] ** 2, np.zeros(3), np.array(pbr["baseColorFactor"][:3]))
    assert evaluate(made, METAL, n=2000)["energy_mean"] < 0.05


def test_gltf_by_pygltflib(tmp_path):
    pygltflib = pytest.importorskip("pygltflib")
    write_gltf(GLOSS, tmp_path / "x.gltf")
    document = pygltflib.GLTF2().load(str(tmp_path / "x.gltf"))
    material = document.materials[0]
    assert document.asset.version == "2.0" and document.extensionsUsed == ["KHR_materials_specular"]
    colour = material.extensions["KHR_materials_specular"]["specularColorFactor"]
    np.testing.assert_allclose(np.array(colour) * 0.04, 0.05, atol=0.02)


def test_materialx_by_its_own_library(tmp_path):
    mx = pytest.importorskip("MaterialX")
    lobes = Mixture(
        [Lambert([0.1, 0.2, 0.3]), Ggx(0.2, 0.4, f0=[0.5, 0.4, 0.3], weight=[0.9, 0.9, 0.9]), Ggx(0.05, f0=[0.1] * 3)]
    )
    with pytest.warns(ExportWarning, match="0.0%"):
        write_materialx(lobes, tmp_path / "x.mtlx", lobes)
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(tmp_path / "x.mtlx"))
    library = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
    document.setDataLibrary(library)
    valid, says = document.validate()
    assert valid, says
    narrow = document.getNode("lobe1")
    assert narrow.getInputValue("roughness") == mx.Vector2(0.05, 0.05) and narrow.getNodeDef() is not None
    wide = document.getNode("lobe2")
    np.testing.assert_allclose(list(wide.getInputValue("color0").asTuple()), [0.45, 0.36, 0.27], rtol=1e-5)
    np.testing.assert_allclose(list(wide.getInputValue("roughness").asTuple()), [0.2, 0.4], rtol=1e-5)


@pytest.mark.parametrize("write", [write_gltf, write_materialx])
def test_only_lobes_have_parameters(write, tmp_path):
    for wrong in (Lambert([0.1, 0.2, 0.3]), Mixture([Lambert(0.1), Ggx(0.2, f0=0.5)])):
        with pytest.raises(ExportError, match="lobes"):
            write(wrong, tmp_path / "x")
    assert list(tmp_path.iterdir()) == []


# ---- Radiance ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def tools():
    pytest.importorskip("pyradiance")
    return Tools()


def rtrace(xml, wi, wo, tools):
    """f (N, 3) at one wi: what rtrace sees of a plane with the BSDF under a small sun of unit irradiance."""
    folder, solid_angle = xml.parent, 2 * np.pi * (1 - np.cos(np.radians(0.25)))
    sun = " ".join([f"{1 / solid_angle / wi[2]:.9g}"] * 3)
    scene = f"void light sun\n0\n0\n3 {sun}\n\nsun source s\n0\n0\n4 {wi[0]} {wi[1]} {wi[2]} 0.5\n\n"
    scene += f"void BSDF m\n6 0 {xml.name} 0 1 0 .\n0\n0\n\n"
    scene += "m polygon p\n0\n0\n12 -9 -9 0 9 -9 0 9 9 0 -9 9 0\n"
    (folder / "s.rad").write_text(scene)
    (folder / "s.oct").write_bytes(tools.run(["oconv", "s.rad"], folder))
    rays = "\n".join(" ".join(f"{v:.9g}" for v in (*(w / 2), *-w)) for w in wo) + "\n"
    options = ["-h", "-ab", "0", "-dj", "0", "-dc", "1", "-dt", "0", "-ds", "0"]
    out = tools.run(["rtrace", *options, "s.oct"], folder, rays.encode())
    return np.array([[float(v) for v in line.split()] for line in out.decode().splitlines() if line.strip()])


def looks():
    theta, phi = np.meshgrid(np.radians([5.0, 25, 40, 60]), np.radians([90.0, 150, 180, 200]), indexing="ij")
    return from_angles(np.radians(40), 0.0), from_angles(theta.ravel(), phi.ravel())


@pytest.mark.slow
def test_a_tensor_tree_renders_in_radiance_as_it_is(tools, tmp_path):
    grey = Mixture([Lambert(0.2), Ggx(0.3, f0=0.4)])
    with pytest.warns(ExportWarning, match="Radiance finds a largest reflectance"):
        write_ttree(grey, tmp_path / "x.xml")
    wi, wo = looks()
    seen, want = rtrace(tmp_path / "x.xml", wi, wo, tools), grey.eval(np.tile(wi, (len(wo), 1)), wo)
    assert np.median(np.abs(seen / want - 1)) < 0.1 and np.abs(seen / want - 1).max() < 0.3
    found = tools.reflectance(tmp_path / "x.xml")
    from gonio.export.exchange.lattice import reflectances

    assert abs(found - reflectances(grey, np.radians(np.arange(0, 81, 10.0))).max()) < 0.05


@pytest.mark.slow
def test_klems_in_colour(tools, tmp_path):
    brdf = Mixture([Lambert([0.1, 0.3, 0.6]), Ggx(0.6, f0=[0.2, 0.2, 0.2])])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ExportWarning)
        write_klems(brdf, tmp_path / "x.xml")
    assert any("Radiance finds" in str(w.message) for w in caught)
    wi, wo = looks()
    seen, want = rtrace(tmp_path / "x.xml", wi, wo, tools), brdf.eval(np.tile(wi, (len(wo), 1)), wo)
    assert np.median(np.abs(seen / want - 1)) < 0.15
    assert (seen[:, 0] < seen[:, 1]).all() and (seen[:, 1] < seen[:, 2]).all()


def test_our_mountain_files_make_an_interpolant(tools, tmp_path):
    from gonio.export.mountain import write_mountain

    files = write_mountain(Lambert(0.5), tmp_path, theta_i_deg=(0, 60))
    made = tools.run(["pabopto2bsdf", *(f.name for f in files)], tmp_path)
    assert made.startswith(b"#?RADIANCE") and b"NAME=gonio" in made and len(made) > 1000


def test_patches_are_klems_own():
    """Each of the 145 is hit, and the first is the cap of 5 degrees."""
    rng = np.random.default_rng(0)
    wo = from_angles(np.arccos(rng.random(200_000)), 2 * np.pi * rng.random(200_000))
    number = _patch(wo)
    assert np.unique(number).tolist() == list(range(145))
    assert (np.degrees(np.arccos(wo[number == 0, 2])) < 5).all()
    assert _lost_to_patches(Lambert(0.5)) < 0.01 < _lost_to_patches(Ggx(0.1, f0=0.5))


def test_without_the_wheel_it_says_what_to_type(monkeypatch, tmp_path):
    import sys

    monkeypatch.setitem(sys.modules, "pyradiance", None)
    with pytest.raises(MissingExtra, match=r"pip install 'gonio\[radiance\]'"):
        write_ttree(Lambert(0.5), tmp_path / "x.xml")
    assert list(tmp_path.iterdir()) == []


def test_a_tool_that_fails_is_named(tools, tmp_path):
    with pytest.raises(ExportError, match="bsdf2ttree: "):
        tools.run(["bsdf2ttree", "nowhere.sir"], tmp_path)
