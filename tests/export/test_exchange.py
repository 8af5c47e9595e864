"""Zemax, ASTM, BRDF-JSON, NeXus: read back, by gonio's import and by what is not gonio's."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest

from gonio.brdf import Ggx, Lambert, Mixture
from gonio.export import ExportError, ExportWarning
from gonio.export.exchange.astm import write_astm
from gonio.export.exchange.brdf_json import write_json
from gonio.export.exchange.lattice import reflectances
from gonio.export.exchange.nexus import write_nexus
from gonio.export.exchange.zemax import write_zemax
from gonio.export.mountain import write_mountain
from gonio.geometry import to_angles
from gonio.importing.delimited import Choices
from gonio.importing.formats import read, sniff
from gonio.importing.run import take
from gonio.run.record.samples import load_samples
from gonio.run.record.store import Store
from gonio.run.start import start

BRDF = Mixture([Lambert([0.1, 0.2, 0.3]), Ggx(0.2, f0=[0.5, 0.4, 0.3])], [0.3, 0.7])
TURNING = Mixture([Lambert(0.2), Ggx(0.2, 0.5, f0=0.4)])


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A small run of a noisy rig."""
    from gonio.config import Material, load_config
    from gonio.config.find import find_config
    from gonio.config.rig import RigConfig

    material = load_config(find_config("analytic_gloss", "materials"), Material, ["budget.measurements=150"])
    rig = load_config(find_config("sim", "rigs"), RigConfig)
    made = start(material, rig, tmp_path_factory.mktemp("runs") / "run")
    made()
    made.close()
    return made.store.folder


def imported(path, **options):
    return take(
        read([path], sniff(path), None, Choices()),
        quantity=None,
        scale=None,
        symmetry=options.get("symmetry", "isotropic"),
    )


@pytest.mark.parametrize("write, name", [(write_zemax, "x.bsdf"), (write_astm, "x.astm")])
def test_a_lattice_comes_back(write, name, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        write(BRDF, tmp_path / name)
    t = imported(tmp_path / name)
    # Zemax keeps what is at the horizon for the entries below it
    up = (t.wo[:, 2] > 0.011) & (t.wi[:, 2] > 0.011)
    np.testing.assert_allclose(t.f[up], BRDF.eval(t.wi[up], t.wo[up]), rtol=3e-3, atol=2e-4)
    assert len(t.f) > 5000 and not t.doubts.lines


@pytest.mark.slow
@pytest.mark.parametrize("write, name", [(write_zemax, "x.bsdf"), (write_astm, "x.astm")])
def test_what_turns_with_the_sample_comes_back(write, name, tmp_path):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ExportWarning)
        write(TURNING, tmp_path / name)
    t = imported(tmp_path / name, symmetry="anisotropic")
    some = np.random.default_rng(0).permutation(len(t.f))[:20_000]
    some = some[(t.wo[some, 2] > 0.011)]
    np.testing.assert_allclose(t.f[some], TURNING.eval(t.wi[some], t.wo[some]), rtol=3e-3, atol=2e-4)
    assert len(np.unique(np.round(to_angles(t.wi)[1], 4))) > 10


@pytest.mark.parametrize("brdf", [BRDF, TURNING], ids=["isotropic", "turning"])
def test_our_mountain_files_come_back(brdf, tmp_path):
    write_mountain(brdf, tmp_path / "m", theta_i_deg=(0, 30, 60))
    t = imported(tmp_path / "m", symmetry="anisotropic")
    np.testing.assert_allclose(t.f, brdf.eval(t.wi, t.wo), rtol=3e-3, atol=1e-4)
    azimuths = np.unique(np.round(np.degrees(to_angles(t.wi)[1][t.wi[:, 2] < 0.99]) % 360, 3))
    assert azimuths.tolist() == ([0.0] if brdf is BRDF else np.arange(15.0, 360, 30).tolist())


def test_a_peak_too_narrow_is_said(tmp_path):
    mirror = Ggx(0.004, f0=[0.9, 0.9, 0.9])
    with pytest.warns(ExportWarning, match="wrong place"):
        write_astm(mirror, tmp_path / "x.astm")


def test_zemax_by_a_reader_of_lines(tmp_path):
    """As a program that knows the format's text but not gonio reads it: keywords, TIS, rows."""
    write_zemax(Lambert(0.5), tmp_path / "x.bsdf")
    lines = [line.split() for line in (tmp_path / "x.bsdf").read_text().splitlines() if line and line[0] != "#"]
    head = {line[0]: line[1] for line in lines[:4]}
    assert head == {
        "Source": "Measured",
        "Symmetry": "PlaneSymmetrical",
        "SpectralContent": "Monochrome",
        "ScatterType": "BRDF",
    }
    keys = ("SampleRotation", "AngleOfIncidence", "ScatterAzimuth", "ScatterRadial")
    counts = {line[0]: int(line[1]) for line in lines if line[0] in keys}
    tis = [k for k, line in enumerate(lines) if line[0] == "TIS"]
    assert len(tis) == counts["SampleRotation"] * counts["AngleOfIncidence"]
    assert all(
        len(lines[k + j]) == counts["ScatterRadial"] for k in tis for j in range(1, counts["ScatterAzimuth"] + 1)
    )
    assert all(abs(float(lines[k][1]) - 0.5) < 0.01 for k in tis)
    assert abs(float(lines[tis[3] + 2][1]) - 0.5 / np.pi) < 1e-6
    assert lines[-1] == ["DataEnd"]


def test_reflectances():
    np.testing.assert_allclose(reflectances(Lambert([0.3, 0.6]), np.radians([0, 60])), [[0.3, 0.6]] * 2, rtol=0.01)


SCHEMA = {
    "type": "object",
    "required": ["theta_i", "phi_i", "theta_r", "phi_r", "BRDF"],
    "additionalProperties": False,
    "properties": {
        **{k: {"type": "object", "required": ["unit", "values"], "additionalProperties": False, "properties": {
            "unit": {"enum": ["rad", "deg", "°"]},
            "values": {"type": "array", "items": {"type": "number", "minimum": 0, "exclusiveMaximum": top}}}}
           for k, top in (("theta_i", 90), ("theta_r", 90), ("phi_i", 360), ("phi_r", 360))},
        **{k: {"type": "object", "required": ["unit", "values"], "additionalProperties": False, "properties": {
            "unit": {"enum": ["1/sr", "sr^-1", "%"]}, "comments": {"type": "string"},
            "values": {"type": "array", "items": {"type": "number", "minimum": 0}}}} for k in ("BRDF", "uBRDF")},
        "wavelength_i": {"type": "object", "required": ["unit", "values"]},
        "adhoc_variables": {"type": "object", "additionalProperties": {
            "type": "object", "required": ["description", "unit", "type", "values"]}},
    },
}  # fmt: skip
"""What data_json_schema_v1.0.json of BiRD_view asks of `data`, in short."""


def test_brdf_json(run, tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    with Store.open(run, write=False) as store:
        write_json(store, tmp_path / "x.brdf")
        samples = load_samples(store)
    whole = json.loads((tmp_path / "x.brdf").read_text())
    jsonschema.validate(whole["data"], SCHEMA, cls=jsonschema.Draft202012Validator)
    assert {"schema", "id", "type", "timestamp", "provenance", "method", "instrumentation", "sample"} <= set(
        whole["metadata"]
    )
    assert whole["metadata"]["method"] == "simulation"
    t = imported(tmp_path / "x.brdf")
    assert t.channels == ("R", "G", "B") and len(t.f) == len(samples)
    key = lambda wi, wo: np.lexsort(np.round(np.concatenate([wi, wo], 1), 7).T)
    a, b = key(t.wi, t.wo), key(samples.wi, samples.wo)
    np.testing.assert_allclose(t.f[a], np.maximum(samples.f[b], 0), rtol=1e-12)
    np.testing.assert_allclose(t.sigma[a], samples.sigma[b], rtol=1e-12)


def test_negative_readings_are_said(tmp_path, run):
    with Store.open(run, write=False) as store:
        m = store.measured()
        f = m.f.copy()
        f[0, 0] = -0.1
        store.measured = lambda: replace(m, f=f)
        with pytest.warns(ExportWarning, match="1 negative"):
            write_json(store, tmp_path / "x.brdf")


def test_nexus(run, tmp_path):
    h5py = pytest.importorskip("h5py")
    with Store.open(run, write=False) as store:
        write_nexus(store, tmp_path / "x.nxs")
        m = store.measured()
    with h5py.File(tmp_path / "x.nxs") as file:
        entry = file[file.attrs["default"]]
        data = entry[entry.attrs["default"]]
        assert entry.attrs["NX_class"] == "NXentry" and data.attrs["NX_class"] == "NXdata"
        np.testing.assert_array_equal(data[data.attrs["signal"]][:], m.f)
        np.testing.assert_array_equal(data["f_errors"][:], m.sigma)
        np.testing.assert_allclose(np.radians(data["theta_i"][:]), to_angles(m.seen[:, :3])[0])
        assert [c.decode() for c in data["channel"][:]] == ["R", "G", "B"]
        assert b"budget" in entry["process/config/data"][()]
    nexus = pytest.importorskip("nexusformat.nexus")
    root = nexus.nxload(str(tmp_path / "x.nxs"))
    assert root.get_default().nxsignal.nxname == "f" and root.get_default().nxerrors is not None


def test_refusals(tmp_path):
    with pytest.raises(ExportError, match="channels"):
        write_zemax(Lambert([0.1, 0.2]), tmp_path / "x.bsdf")

    class Negative(Lambert):
        def eval(self, wi, wo):
            return super().eval(wi, wo) - 0.1

    for write in (write_zemax, write_astm):
        with pytest.raises(ExportError, match="negative"):
            write(Negative([0.1, 0.2, 0.3]), tmp_path / "x")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("write, name", [(write_zemax, "x.bsdf"), (write_astm, "x.astm")])
def test_a_round_trip_keeps_the_energy(write, name, tmp_path):
    """Exported, imported, reconstructed."""
    from gonio.evaluate import evaluate
    from gonio.reconstruct import Samples, reconstruct

    write(BRDF, tmp_path / name)
    t = imported(tmp_path / name)
    some = np.random.default_rng(0).permutation(len(t.f))[:5000]
    back = reconstruct(Samples.of(t.wi[some], t.wo[some], t.f[some]))
    assert evaluate(back, BRDF)["energy_mean"] < 0.01
