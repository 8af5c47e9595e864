"""`gonio import` as it is typed: a run folder that the other commands work on, or a line and nothing."""

import contextlib
import io
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from importing import files

import gonio as package
from gonio.cli import main
from gonio.evaluate import evaluate
from gonio.run.record.config import read_config
from gonio.run.record.store import Store


def gonio(*words):
    """The command in this process, as `main` ends it: returncode, stdout, stderr."""
    out, err, before = io.StringIO(), io.StringIO(), sys.argv
    sys.argv = ["gonio", *map(str, words)]
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main()
        except SystemExit as e:
            code = e.code
        finally:
            sys.argv = before
    return SimpleNamespace(returncode=code or 0, stdout=out.getvalue(), stderr=err.getvalue())


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A CSV that needs nothing said, imported."""
    folder = tmp_path_factory.mktemp("imports")
    (folder / "my sample.csv").write_text(files.csv(files.scattered(1500)))
    done = gonio("import", folder / "my sample.csv", "--out", folder / "run")
    assert done.returncode == 0, done.stderr
    assert "1500 readings of 3 channels" in done.stdout
    return folder / "run"


def test_the_run_says_where_it_comes_from(run):
    import hashlib

    config = read_config(run)
    assert config.imported is not None and config.imported.files == ("my sample.csv",)
    sha = hashlib.sha256((run.parent / "my sample.csv").read_bytes()).hexdigest()
    assert config.imported.sha256 == (sha,) and config.imported.mapping["f_R"] == "f:R"
    assert config.material.name == "my_sample" and config.material.channels == ("R", "G", "B")
    with Store.open(run, write=False) as store:
        assert store.get("provenance")["imported"]["sha256"] == [sha]
        assert store.get("provenance")["simulated"] is False
        m = store.measured()
    np.testing.assert_allclose(m.f, files.BRDF.eval(m.seen[:, :3], m.seen[:, 3:]), rtol=1e-6)
    assert sorted(p.name for p in run.parent.iterdir()) == ["my sample.csv", "run"]


@pytest.mark.slow
def test_the_other_commands_work_on_it(run):
    for words in (["reconstruct", run], ["report", run], ["export", run], ["export", run, "--format", "netcdf"]):
        done = gonio(*words)
        said = [line for line in done.stderr.splitlines() if not line.startswith("note ")]
        assert done.returncode == 0 and not said, (words, done.stderr)
    assert evaluate(package.load_brdf(run), files.BRDF)["energy_mean"] < 0.03
    page = (run / "report.html").read_text()
    assert "imported from" in page and "gonio resume" not in page
    lines = open(gonio("export", run, "--format", "csv").stdout.strip()).read().splitlines()
    assert len(lines) == 1501 and ",imported,1," in lines[1]
    again = gonio("import", run / "samples.csv", "--out", run.parent / "again")
    assert again.returncode == 0, again.stderr
    with Store.open(run, write=False) as a, Store.open(run.parent / "again", write=False) as b:
        np.testing.assert_allclose(np.sort(a.measured().f, 0), np.sort(b.measured().f, 0), rtol=1e-12)
    assert json.loads(gonio("status", run, "--json").stdout)["source"].startswith("imported from my sample.csv")
    done = gonio("evaluate", run, "--truth", run / "brdf.bsdf", "--json")
    assert json.loads(done.stdout)["energy_mean"] < 0.02


def test_nothing_measures_on(run):
    done = gonio("resume", run)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "imported from my sample.csv" in done.stderr
    done = gonio("acquire", "analytic_gloss", "--rig", "ideal", "--out", run)
    assert done.returncode == 2 and "exists already" in done.stderr
    assert gonio("evaluate", run).returncode == 2


def test_a_guess_is_shown_and_waits_for_yes(tmp_path):
    theta_i, theta_o, phi = files.grid()
    f = files.GREY.eval(*files.pairs(theta_i, theta_o, phi))[:, 0]
    (tmp_path / "x.csv").write_text(files.table(["AOI", "theta_r", "Azimuth", "BRDF"], [theta_i, theta_o, phi, f]))
    done = gonio("import", tmp_path / "x.csv", "--out", tmp_path / "run")
    assert done.returncode == 2 and "--yes" in done.stderr and not (tmp_path / "run").exists()
    assert "AOI      theta_i" in done.stdout and "guess" in done.stdout
    done = gonio("import", tmp_path / "x.csv", "--out", tmp_path / "run", "--yes")
    assert done.returncode == 0 and "azimuth 180" in done.stdout
    by_hand = [a for n, r in zip(["AOI", "theta_r", "Azimuth", "BRDF"], ["theta_i", "theta_o", "phi", "f"])
               for a in ("--column", f"{n}={r}")]  # fmt: skip
    assert gonio("import", tmp_path / "x.csv", "--out", tmp_path / "two", *by_hand).returncode == 0


def test_a_contradiction_waits_for_force(tmp_path):
    (tmp_path / "x.csv").write_text(files.csv(files.scattered(), lambda f, wo: f * wo[:, 2:]))
    done = gonio("import", tmp_path / "x.csv", "--out", tmp_path / "run")
    assert done.returncode == 2 and "--value f_cos" in done.stderr and not (tmp_path / "run").exists()
    assert done.stderr.count("\n") == 1
    assert gonio("import", tmp_path / "x.csv", "--out", tmp_path / "run", "--force").returncode == 0
    assert any(line.startswith("doubt") for line in read_config(tmp_path / "run").imported.said)
    assert gonio("import", tmp_path / "x.csv", "--out", tmp_path / "two", "--value", "f_cos").returncode == 0


@pytest.mark.parametrize(
    "words, says",
    [
        (["nowhere.csv"], "does not exist"),
        (["x.csv", "--format", "xls"], "--format xls: not one of csv"),
        (["x.csv", "--value", "watts"], "--value watts"),
        (["x.csv", "--angles", "gon"], "--angles gon"),
        (["x.csv", "--specular", "90"], "--specular 90"),
        (["x.csv", "--scale", "-1"], "--scale -1"),
        (["x.csv", "x.csv"], "one file at a time"),
        (["x.txt", "--column", "a=f"], "no columns to name"),
    ],
)
def test_a_mistake_is_one_line(words, says, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.csv").write_text(files.csv())
    (tmp_path / "x.txt").write_text(files.pab())
    done = gonio("import", *words, "--out", "run")
    assert done.returncode == 2 and says in done.stderr and done.stderr.count("\n") == 1, done.stderr
    assert not (tmp_path / "run").exists()


def test_a_folder_of_pab_becomes_a_run_of_its_files(tmp_path):
    (tmp_path / "panel").mkdir()
    for angle in (10, 50):
        (tmp_path / "panel" / f"a{angle}.txt").write_text(files.pab(angle))
    done = gonio("import", tmp_path / "panel", "--out", tmp_path / "run")
    assert done.returncode == 0, done.stderr
    found = read_config(tmp_path / "run").imported
    assert found.files == ("a10.txt", "a50.txt") and len(set(found.sha256)) == 2


def test_an_azimuth_among_the_unused_columns_is_asked_for(tmp_path):
    theta_i, theta_o, phi = files.grid()
    f = files.GREY.eval(*files.pairs(theta_i, theta_o, phi))[:, 0]
    (tmp_path / "x.csv").write_text(files.table(["theta_i", "theta_o", "turn", "f"], [theta_i, theta_o, phi, f]))
    done = gonio("import", tmp_path / "x.csv", "--yes", "--out", tmp_path / "run")
    assert done.returncode == 2 and "(turn) the azimuth? --column NAME=phi" in done.stderr
    assert done.stderr.count("\n") == 1 and not (tmp_path / "run").exists()
    words = ["import", tmp_path / "x.csv", "--yes", "--out", tmp_path / "run"]
    assert gonio(*words, "--column", "turn=phi").returncode == 0
    rng = np.random.default_rng(0)  # repeats of a scan, numbered
    theta = np.repeat(np.arange(0, 80, 2.0), 5)
    f = files.GREY.eval(*files.pairs(0 * theta + 20, theta, 0 * theta))[:, 0]
    columns = [0 * theta + 20, -theta, np.arange(len(f)), f * (1 + 0.1 * rng.standard_normal(len(f))), 0.1 * f]
    (tmp_path / "y.csv").write_text(files.table(["theta_i", "theta_o", "number", "f", "sigma"], columns))
    assert gonio("import", tmp_path / "y.csv", "--yes", "--out", tmp_path / "two").returncode == 0
