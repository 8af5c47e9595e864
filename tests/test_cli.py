"""The commands as a user types them: exit codes, one-line errors, products."""

import json
import subprocess
import sys

import numpy as np
import pytest

from gonio.run.record.store import Store


def gonio(*args, cwd=None, env=None):
    command = [sys.executable, "-m", "gonio.cli", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, env=env, timeout=300)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A small run with all its products."""
    folder = tmp_path_factory.mktemp("runs") / "run"
    done = gonio("acquire", "analytic_gloss", "--rig", "ideal", "--out", folder, "--set", "budget.measurements=600")
    assert done.returncode == 0, done.stderr
    for word in ("run ", "truth ", "ended budget of 600", "brdf ", "bsdf ", "report "):
        assert word in done.stdout
    assert "measured 600/600" in done.stderr and "acceptance" in done.stderr
    return folder


def test_a_run_folder_has_everything(run):
    names = {p.name for p in run.iterdir()}
    assert {"config.yaml", "run.sqlite", "log.txt", "brdf.npz", "brdf.bsdf", "report.html"} <= names
    with Store.open(run, write=False) as store:
        p = store.get("provenance")
        assert p["simulated"] is True and p["seed"] == 0 and p["truth"]
        assert len(store.measured().id) == 600


def test_the_report_is_self_contained(run):
    page = (run / "report.html").read_text()
    assert page.count("data:image/png;base64,") >= 6
    assert "http://" not in page and "https://" not in page and "<script" not in page
    for word in ("Sphere", "Slices", "Acceptance", "Albedo over", "energy_mean"):
        assert word in page


def test_evaluate(run):
    done = gonio("evaluate", run, "--json")
    figures = json.loads(done.stdout)
    assert figures["energy_mean"] < 0.15
    other = gonio("evaluate", run / "brdf.npz", "--truth", "analytic_gloss", "--json")
    albedo = {k for k in figures if k.startswith("albedo")}
    assert json.loads(other.stdout) == {k: v for k, v in figures.items() if k not in albedo}
    assert len(figures["albedo"]) == 9 and len(albedo) == 5
    said = gonio("evaluate", run).stdout
    assert "energy_mean" in said and "albedo, θi 40–50°  R 0." in said


def test_evaluate_says_what_the_referee_says(run, score):
    import gonio as package
    from gonio.run.truth import open_truth

    ours = json.loads(gonio("evaluate", run, "--json").stdout)
    theirs = score.score(package.load_brdf(run).eval, open_truth("analytic_gloss").eval)
    assert all(abs(ours[k] - theirs[k]) < 1e-6 for k in theirs)


def test_csv_has_a_row_for_every_step(run):
    path = gonio("export", run, "--format", "csv").stdout.strip()
    lines = open(path).read().splitlines()
    header = lines[0].split(",")
    assert (
        header[:11]
        == "chain step kind measured accepted repeats log_q theta_i_deg phi_i_deg theta_o_deg phi_o_deg".split()
    )
    assert header[11:20] == "f_0 f_1 f_2 sigma_0 sigma_1 sigma_2 saturated rig_s wall_s".split()
    assert header[20:26] == "brdf_0 brdf_1 brdf_2 std_0 std_1 std_2".split() and header[-1] == "high99_2"
    rows = [dict(zip(header, line.split(","))) for line in lines[1:]]
    measured = [r for r in rows if r["measured"] == "1"]
    assert len(measured) == 600
    assert all(r["theta_i_deg"] for r in rows)
    steps = [r for r in rows if int(r["step"]) >= 0]
    first = next(k for k, r in enumerate(steps) if r["accepted"] == "1")
    assert sum(int(r["repeats"]) for r in rows) == len(steps) - first


@pytest.mark.parametrize(("format", "extra"), [("parquet", "pyarrow"), ("netcdf", "arviz")])
def test_other_tables(run, format, extra):
    module = pytest.importorskip(extra, reason=f"{extra} is in the study extra")
    path = gonio("export", run, "--format", format).stdout.strip()
    if format == "parquet":
        import pyarrow.parquet as parquet

        assert parquet.read_table(path).num_rows >= 600
    else:
        data = module.from_netcdf(path)
        assert data.posterior["theta_h"].dims == ("chain", "draw")
        assert np.isfinite(data.sample_stats["lp"]).all()


@pytest.mark.parametrize("format", ["bsdf", "merl", "grid", "mountain"])
def test_brdf_formats(run, tmp_path, format):
    done = gonio("export", run, "--format", format, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out").exists()


@pytest.mark.parametrize("model", ["ggx", "thesis", "abc", "lobes"])
def test_other_models(run, tmp_path, model):
    done = gonio("reconstruct", run, "--model", model, "--out", tmp_path / "b.npz")
    assert done.returncode == 0, done.stderr
    assert gonio("evaluate", tmp_path / "b.npz", "--truth", "analytic_gloss").returncode == 0


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["acquire", "no_such_material"], ["no_such_material", "analytic_gloss"]),
        (["acquire", "none.yaml"], ["none.yaml"]),
        (["acquire", "analytic_gloss", "--set", "budget.measurments=3"], ["measurments", "measurements"]),
        (["acquire", "analytic_gloss", "--set", "truth=nothing_known"], ["nothing_known"]),
        (["acquire", "analytic_gloss", "--set", "truth=/no/such.bsdf"], ["/no/such.bsdf"]),
        (["acquire", "analytic_gloss", "--rig", "no_rig"], ["no_rig", "sim"]),
        (["acquire", "analytic_gloss", "--set", "channels=2"], ["channels"]),
        (["acquire", "analytic_gloss", "--set", "budget.measurements=-1"], ["budget.measurements"]),
        (["acquire", "analytic_gloss", "--set", "sampler.flow.weights=none.npz"], ["none.npz", "bench pretrain"]),
        (["acquire", "analytic_gloss", "--set", "channels=[L]", "--rig", "camera"], ["channels", "has 1, the camera"]),
        (["acquire"], ["Usage", "config"]),
        (["resume", "nowhere"], ["nowhere"]),
        (["reconstruct", "nowhere"], ["nowhere"]),
        (["evaluate", "nowhere"], ["nowhere"]),
        (["export", "nowhere"], ["nowhere"]),
        (["report", "nowhere"], ["nowhere"]),
        (["bench", "nowhere"], ["nowhere"]),
        (["frobnicate"], ["frobnicate"]),
        (["materials", "fetch", "no_such"], ["no_such"]),
    ],
)
def test_mistakes_end_in_a_line_and_exit_2(tmp_path, args, words):
    done = gonio(*args, cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "Traceback" not in done.stderr and all(w in done.stderr for w in words), done.stderr
    assert not list(tmp_path.iterdir()), "something half-written was left"


def test_an_output_folder_that_exists(run, tmp_path):
    before = sorted(p.name for p in run.iterdir())
    done = gonio("acquire", "analytic_gloss", "--rig", "ideal", "--out", run)
    assert done.returncode == 2 and "exists already" in done.stderr and "Traceback" not in done.stderr
    assert sorted(p.name for p in run.iterdir()) == before


def test_a_run_in_use(run):
    with Store.open(run, write=True):
        done = gonio("resume", run)
    assert done.returncode == 2 and "in use" in done.stderr


def test_a_damaged_truth_names_the_byte(tmp_path, run):
    data = (run / "brdf.bsdf").read_bytes()
    (tmp_path / "cut.bsdf").write_bytes(data[: len(data) // 2])
    done = gonio("acquire", "analytic_gloss", "--set", f"truth={tmp_path / 'cut.bsdf'}", "--out", tmp_path / "r")
    assert done.returncode == 2 and "cut.bsdf" in done.stderr and "Traceback" not in done.stderr
    assert not (tmp_path / "r").exists()


def test_resume_with_a_larger_budget_goes_on(tmp_path):
    folder = tmp_path / "r"
    base = ["acquire", "analytic_gloss", "--rig", "ideal", "--no-post", "--set", "sampler.proposal=pss_simple"]
    assert gonio(*base, "--out", folder, "--set", "budget.measurements=150").returncode == 0
    assert gonio("resume", folder, "--set", "budget.measurements=250", "--no-post").returncode == 0
    whole = tmp_path / "whole"
    assert gonio(*base, "--out", whole, "--set", "budget.measurements=250").returncode == 0
    with Store.open(folder, write=False) as a, Store.open(whole, write=False) as b:
        assert np.array_equal(a.measured().asked, b.measured().asked)
    assert gonio("resume", folder, "--set", "sampler.sigma=0.2").returncode == 2


@pytest.mark.parametrize("stop", ["stop.energy_error=0.2", "stop.ess=100", "budget.rig_hours=0.05"])
def test_stop_rules_end_a_run_and_say_so(tmp_path, stop):
    done = gonio("acquire", "analytic_gloss", "--rig", "ideal", "--no-post", "--out", tmp_path / "r", "--set", stop)
    assert done.returncode == 0, done.stderr
    ended = next(line for line in done.stdout.splitlines() if line.startswith("ended"))
    assert {"s": "goal", "b": "rig hours"}[stop[0]] in ended


@pytest.mark.parametrize("proposal", ["pss_simple", "pss_vndf", "vmf_io", "vmf_hd", "independence", "auto", "delayed"])
def test_every_proposal_runs_from_the_command_line(tmp_path, proposal):
    args = [
        "--set",
        f"sampler.proposal={proposal}",
        "--set",
        "budget.measurements=200",
        "--no-post",
        "--out",
        tmp_path / "r",
    ]
    done = gonio("acquire", "analytic_gloss", "--rig", "ideal", *args)
    assert done.returncode == 0, done.stderr


def test_check_prints_the_plan():
    out = gonio("check", "analytic_gloss").stdout
    for word in ("isotropic", "dimensions", "reachable", "rig time", "auto"):
        assert word in out


@pytest.mark.parametrize(
    "words", [["-h"], ["--help"], ["check", "-h"], ["calibrate", "-h"], ["calibrate", "camera", "-h"]]
)
def test_help_has_a_short_name(words):
    done = gonio(*words)
    assert done.returncode == 0 and done.stdout.startswith("Usage:")


def test_version():
    from gonio import __version__

    assert gonio("--version").stdout == f"gonio {__version__}\n"
