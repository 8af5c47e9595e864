"""`gonio export` as it is typed: a path on stdout, on stderr what the file cannot hold."""

import pytest
from importing import files
from importing.test_import import gonio


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    (folder / "x.csv").write_text(files.csv(files.scattered(400)))
    assert gonio("import", folder / "x.csv", "--out", folder / "run").returncode == 0
    assert gonio("reconstruct", folder / "run", "--model", "lobes").returncode == 0
    return folder / "run"


@pytest.mark.slow
@pytest.mark.parametrize("format", ["bsdf", "zemax", "astm", "gltf", "materialx", "json", "nexus", "csv", "parquet"])
def test_every_format_is_a_path_and_notes(run, format):
    done = gonio("export", run, "--format", format)
    assert done.returncode == 0, done.stderr
    path = run / done.stdout.strip().split("/")[-1]
    assert path.exists() and path.stat().st_size > 100
    assert all(line.startswith("note   ") for line in done.stderr.splitlines())
    assert ("--spectral" in done.stderr) == (format == "bsdf")
    assert ("wrong place" in done.stderr) >= (format in ("gltf", "materialx"))


@pytest.mark.slow
def test_spectral(run):
    mitsuba = pytest.importorskip("mitsuba")
    done = gonio("export", run, "--spectral")
    assert done.returncode == 0 and not done.stderr and done.stdout.strip().endswith("brdf_spectral.bsdf")
    mitsuba.set_variant("scalar_spectral")
    bsdf = mitsuba.load_dict({"type": "measured", "filename": done.stdout.strip()})
    assert "measured" in str(bsdf).lower()


def test_refusals_are_one_line(run):
    for words, says in ((["--format", "doc"], "--format doc"), (["--format", "merl", "--spectral"], "--spectral")):
        done = gonio("export", run, *words)
        assert done.returncode == 2 and says in done.stderr and done.stderr.count("\n") == 1
