"""What people say of a sample is in the run, its report, and in every export that can hold text."""

import json
import subprocess
import sys

import numpy as np
import pytest
import yaml

import gonio
from gonio.config import ConfigError, Material
from gonio.config.loader import parse_config
from gonio.run.exports import export_run

SAID = {
    "sample_id": "A 7/3",
    "operator": "Zoë",
    "notes": "sanded;\nthen wiped: twice",
    "metadata": {"batch": "007", "mm": 1.5},
}
WANTED = {"sample_id": "A 7/3", "operator": "Zoë", "metadata.batch": "007", "metadata.mm": 1.5}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    material = gonio.Material("analytic_gloss", budget={"measurements": 60}, **SAID)
    run = gonio.acquire(material, "ideal", tmp_path_factory.mktemp("runs") / "run")
    run.brdf("ggx")
    subprocess.run([sys.executable, "-m", "gonio.cli", "reconstruct", run.folder, "--model", "ggx"], check=True)
    return run


def test_the_run_keeps_it(run):
    assert run.material.notes == SAID["notes"] and run.material.metadata == {"batch": "007", "mm": 1.5}


def test_bsdf(run, tmp_path):
    export_run(run.folder, "bsdf", tmp_path / "x.bsdf")
    description = gonio.load_brdf(tmp_path / "x.bsdf").description
    assert all(f"{k}: {v}" in description.splitlines() for k, v in WANTED.items())
    assert "notes: sanded; then wiped: twice" in description


def test_grid(run, tmp_path):
    export_run(run.folder, "grid", tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz", allow_pickle=False) as file:
        assert all(f"{k}: {v}" in file["about"].tolist() for k, v in WANTED.items())
    assert gonio.load_brdf(tmp_path / "x.npz").channels == 3


def test_mountain(run, tmp_path):
    export_run(run.folder, "mountain", tmp_path / "m")
    files = sorted((tmp_path / "m").iterdir())
    lines = files[0].read_text().splitlines()
    assert all(f"#about {k}: {v}" in lines for k, v in WANTED.items())
    assert len({len([line for line in p.read_text().splitlines() if line[0] == "#"]) for p in files}) == 1


def test_csv_has_it_beside(run, tmp_path):
    path = export_run(run.folder, "csv", tmp_path / "x.csv")
    said = json.loads((tmp_path / "x.csv-metadata.json").read_text())
    assert said["url"] == "x.csv" and said["notes"][0] == {"name": "analytic_gloss", **WANTED, "notes": SAID["notes"]}
    assert path.read_text().startswith("chain,step")


def test_a_csv_of_which_nothing_is_known_has_nothing_beside(tmp_path):
    run = gonio.acquire(gonio.Material("analytic_gloss", budget={"measurements": 5}), "ideal", tmp_path / "run")
    run.export("csv", tmp_path / "x.csv")
    assert not (tmp_path / "x.csv-metadata.json").exists()


def test_parquet(run, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet", reason="in the study extra")
    known = parquet.read_schema(export_run(run.folder, "parquet", tmp_path / "x.parquet")).metadata
    assert all(known[k.encode()].decode() == str(v) for k, v in WANTED.items())


def test_netcdf_and_xarray(run, tmp_path):
    xarray = pytest.importorskip("xarray", reason="in the study extra")
    pytest.importorskip("h5netcdf", reason="in the study extra")
    path = export_run(run.folder, "netcdf", tmp_path / "x.nc")
    for attrs in (xarray.load_dataset(path, group="posterior", engine="h5netcdf").attrs, run.to_xarray().attrs):
        assert all(attrs[k] == v for k, v in WANTED.items())


@pytest.mark.slow
def test_report(run):
    page = run.report().read_text()
    assert all(word in page for word in ("A 7/3", "Zoë", "then wiped", "metadata.batch", "<td>007"))


def test_metadata_means_what_is_written():
    text = "name: m\nmetadata: {a: 007, b: 12, c: 0.50, d: no, e: true, f: 1:30, g: 1_000, h: '5', i: -1.5e3, j: 0x10"
    text += ", k: 2026-01-02, n: 1e4, o: .nan}"
    found = parse_config(text, Material, ("metadata.l=010", "metadata.m=3")).metadata
    want = {"a": "007", "b": 12, "c": 0.5, "d": "no", "e": True, "f": "1:30", "g": "1_000", "h": "5", "i": -1500.0,
            "j": "0x10", "k": "2026-01-02", "n": "1e4", "o": ".nan", "l": "010", "m": 3}  # fmt: skip
    assert found == want and [type(v) for v in found.values()] == [type(v) for v in want.values()]


@pytest.mark.parametrize(
    ("metadata", "words"),
    [
        ({"a": [1]}, "metadata.a"),
        ({"a": {"b": 1}}, "metadata.a"),
        ({"a": None}, "metadata.a"),
        ({"": 1}, "keys have"),
        ({"a": "x" * 10_001}, "10,000"),
        ({str(k): k for k in range(201)}, "200"),
        ([1], "metadata"),
    ],
)
def test_metadata_that_is_refused(metadata, words):
    with pytest.raises(ConfigError, match=words) as caught:
        parse_config(yaml.safe_dump({"name": "m", "metadata": metadata}), Material, source="m.yaml")
    assert "\n" not in str(caught.value)


def test_brdf_json_and_nexus(run, tmp_path):
    said = json.loads(export_run(run.folder, "json", tmp_path / "x.brdf").read_text())["metadata"]["provenance"]
    assert all(f"{k}: {v}" in said["comments"] for k, v in WANTED.items())
    h5py = pytest.importorskip("h5py", reason="needs the extra `study`")
    with h5py.File(export_run(run.folder, "nexus", tmp_path / "x.nxs")) as file:
        sample = file["entry/sample"]
        assert sample["sample_id"][()].decode() == "A 7/3" and sample["operator"][()].decode() == "Zoë"
        assert sample["metadata_batch"][()].decode() == "007" and sample["metadata_mm"][()] == 1.5
