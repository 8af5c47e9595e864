"""gonio scan: a list of directions through the same rig, planner and store; a run as any other."""

import contextlib
import csv
import io
import json
import random
import subprocess
import sys
import tracemalloc

import numpy as np
import pytest

import gonio as package
from gonio.brdf.library import find
from gonio.cli import main
from gonio.config import ConfigError
from gonio.config.scan import MOST, Scan, in_plane, read_scan
from gonio.mcmc.listed import Listed
from gonio.run.record.store import Store
from tests.daemon.conftest import PLANNED

PLANE = ["--theta-i", "30", "--theta-i", "60", "--from", "-75", "--to", "75", "--step", "15"]


def gonio(*args, cwd="."):
    """The command in this process: returncode, stdout, stderr."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.chdir(cwd), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        with pytest.MonkeyPatch.context() as patch, pytest.raises(SystemExit) as ended:
            patch.setattr(sys, "argv", ["gonio", *map(str, args)])
            main()
    return subprocess.CompletedProcess(args, ended.value.code, out.getvalue(), err.getvalue())


def killed(*args, **plan):
    command = [sys.executable, "-c", PLANNED, json.dumps(plan), *map(str, args)]
    return subprocess.run(command, capture_output=True, timeout=300).returncode


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scans") / "run"
    done = gonio("scan", "analytic_gloss", *PLANE, "--repeats", 3, "--rig", "sim", "--out", folder)
    assert done.returncode == 0, done.stderr
    assert "scan  20 pairs, 3 x; 2 out of reach" in done.stdout and "ended budget of 60" in done.stdout
    return folder


def rows_of(path):
    return list(csv.DictReader(path.open()))


def test_each_pair_as_often_as_asked(run):
    rows = rows_of(run / "scan.csv")
    assert len(rows) == 20 and {r["readings"] for r in rows} == {"3"}
    truth = package.load_brdf("analytic_gloss")
    angles = np.radians([[float(r[k]) for k in ("theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg")] for r in rows])
    wi, wo = package.from_angles(angles[:, 0], angles[:, 1]), package.from_angles(angles[:, 2], angles[:, 3])
    f = np.array([[float(r[f"f_{c}"]) for c in "RGB"] for r in rows])
    sigma = np.array([[float(r[f"sigma_{c}"]) for c in "RGB"] for r in rows])
    assert np.abs(f - truth.eval(wi, wo)).max() < 0.05 * truth.eval(wi, wo).max() and (sigma > 0).all()
    peak = rows[int(np.argmax(f[:, 0]))]
    assert (peak["theta_i_deg"], peak["theta_o_deg"], peak["phi_o_deg"]) == ("60.0", "60.0", "0.0")


@pytest.mark.slow
def test_what_is_made_of_it(run, tmp_path):
    assert (run / "scan.png").read_bytes()[:4] == b"\x89PNG" and not (run / "brdf.npz").exists()
    assert gonio("reconstruct", run, "--model", "ggx").returncode == 0
    page = gonio("report", run)
    assert page.returncode == 0 and "Warning" not in page.stderr, page.stderr
    for format in ("csv", "bsdf", "netcdf"):
        assert gonio("export", run, "--format", format, "--out", tmp_path / format).returncode == 0
    steps = rows_of(tmp_path / "csv")
    assert (
        len(steps) == 60 and {s["kind"] for s in steps} == {"listed"} and {s["chain"] for s in steps} == {"0", "1", "2"}
    )


def test_a_pass_after_the_other_each_in_the_cheapest_order(run):
    with Store.open(run, write=False) as store:
        m = store.measured()
    by_time = m.id[np.argsort(m.wall_s, kind="stable")]
    assert np.array_equal(np.sort(by_time.reshape(3, 20), 1), np.arange(60).reshape(3, 20))
    assert (by_time[:20] != np.arange(20)).any(), "the planner orders it"


@pytest.mark.slow
@pytest.mark.parametrize("where", ["before", "between", "after"])
def test_killed_and_resumed_it_is_the_same(run, tmp_path, where):
    args = ["scan", "analytic_gloss", *PLANE, "--repeats", 3, "--rig", "sim", "--out", tmp_path / "run"]
    assert killed(*args, measured=30, where=where) == -9
    done = gonio("resume", tmp_path / "run")
    assert done.returncode == 0 and "plot" in done.stdout, done.stderr
    assert (tmp_path / "run" / "scan.csv").read_bytes() == (run / "scan.csv").read_bytes()


def test_more_passes(tmp_path):
    assert gonio("scan", "analytic_gloss", *PLANE, "--rig", "ideal", "--out", tmp_path / "run").returncode == 0
    done = gonio("resume", tmp_path / "run", "--set", "budget.measurements=30")
    assert done.returncode == 0, done.stderr
    assert sorted(int(r["readings"]) for r in rows_of(tmp_path / "run" / "scan.csv")) == [1] * 14 + [2] * 8


def test_a_table(tmp_path):
    (tmp_path / "list.csv").write_text("\ufefftheta_o_deg,name,theta_i_deg\n0,a,45\n\n30,b,45\n", encoding="utf-8")
    done = gonio("scan", "analytic_gloss", "list.csv", "--rig", "ideal", "--out", "run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    rows = rows_of(tmp_path / "run" / "scan.csv")
    found = [(r["theta_i_deg"], r["theta_o_deg"], r["phi_o_deg"]) for r in rows]
    assert found == [("45.0", "0.0", "180.0"), ("45.0", "30.0", "180.0")]


def test_the_plane():
    scan = in_plane([30.0], -10, 10, 10, phi_deg=90)
    assert scan.pairs_deg == ((30, -90, 10, -90), (30, -90, 0, 90), (30, -90, 10, 90))
    assert len(in_plane([10.0], -80, 80, 0.1).pairs_deg) == 1601


def test_listed_hands_out_again_what_was_not_told():
    up = np.tile([0, 0, 1.0], (4, 1))
    listed = Listed(up, up)
    listed.tell([2, 0], np.array([[1.0], [np.nan]]))
    assert listed.ask().ids.tolist() == [1, 3] and listed.unmeasured_in_a_row == 1
    listed.tell([1, 3], np.ones((2, 1)))
    assert listed.ask().ids.tolist() == [4, 5, 6, 7] and listed.unmeasured_in_a_row == 0
    for wrong in ([3], [8]):
        with pytest.raises(KeyError):
            listed.tell(wrong, np.ones((1, 1)))
    assert sorted(listed.take_steps().id) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("args", "words"),
    [
        ([], ["--theta-i"]),
        (["--theta-i", "30", "--from", "20", "--to", "10"], ["--from below --to"]),
        (["--theta-i", "30", "--step", "0"], ["--step above 0"]),
        (["--theta-i", "90"], ["below 90"]),
        (["--theta-i", "nan"], ["numbers of degrees"]),
        (["--theta-i", "30", "--step", "1e-9"], [f"{MOST} at most"]),
        (["--theta-i", "30", "--repeats", "0"], ["repeats"]),
        (["--theta-i", "0", "--from", "0", "--to", "0"], ["reaches none", "stay_out_deg"]),
        (["none.csv"], ["none.csv"]),
        (["list.csv", "--theta-i", "30"], ["one of them"]),
    ],
)
def test_mistakes_are_a_line_and_leave_nothing(tmp_path, args, words):
    done = gonio("scan", "analytic_gloss", *args, cwd=tmp_path)
    assert done.returncode == 2 and "Traceback" not in done.stderr and all(w in done.stderr for w in words), done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "list.csv:1: no column theta_i_deg"),
        ("theta_i_deg,theta_o_deg\n", "no rows"),
        ("theta_i_deg,theta_o_deg\n1,\n", "list.csv:2: theta_o_deg: empty"),
        ("theta_i_deg,theta_o_deg\n1,2\n3\n", "list.csv:3: theta_o_deg: empty"),
        ("theta_i_deg,theta_o_deg\n1,x\n", "list.csv:2: theta_o_deg: 'x' is not"),
        ("theta_i_deg,theta_o_deg\nnan,2\n", "list.csv:2: theta_i_deg: 'nan' is not a number"),
        ("theta_i_deg,theta_o_deg\n1_0,2\n", "'1_0' is not a number"),
        ("theta_i_deg,theta_o_deg\n\u0663,2\n", "is not a number"),
        ("theta_i_deg,theta_o_deg\n1e999,2\n", "1e999 is out of range"),
        ("theta_i_deg,theta_o_deg\n-3,2\n", "theta_i_deg: -3 is out of range"),
        ("theta_i_deg,theta_o_deg\n0.5,90\n", "theta_o_deg: 90 is out of range"),
        ("theta_i_deg,theta_o_deg,phi_i_deg\n1,2,\n", "phi_i_deg: empty"),
        ("theta_i_deg,theta_o_deg,theta_o_deg\n1,2,3\n", "twice"),
        ("theta_i_deg,theta_o_deg\n" + "1,2\n" * (MOST + 1), f"more than {MOST}"),
    ],
)
def test_tables_that_are_refused(tmp_path, text, words):
    (tmp_path / "list.csv").write_text(text)
    with pytest.raises(ConfigError) as caught:
        read_scan(tmp_path / "list.csv")
    assert words in str(caught.value) and "\n" not in str(caught.value)


def test_mutated_tables_give_a_scan_or_one_line(tmp_path):
    rng, path = random.Random(1), tmp_path / "list.csv"
    whole = ("theta_i_deg,phi_i_deg,theta_o_deg,phi_o_deg\n" + "30.5,0,12,180\n" * 20).encode()
    junk = [b"\xff", b"\0", b'"', b"\n", b",", b"1e999", b"nan", b"-", b"\r", b"9" * 400, b"\xef\xbb\xbf"]
    tracemalloc.start()
    for _ in range(300):
        data = bytearray(whole)
        for _ in range(rng.randint(1, 4)):
            k = rng.randrange(len(data) + 1)
            data[k : k + rng.randint(0, 9)] = rng.choice(junk)
        path.write_bytes(bytes(data[: rng.choice([len(data), rng.randrange(len(data) + 1)])]))
        try:
            assert isinstance(read_scan(path), Scan)
        except ConfigError as e:
            assert "\n" not in str(e)
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()


def test_through_a_daemon(tmp_path):
    from tests.daemon.conftest import Daemon

    assert find("analytic_gloss")
    daemon = Daemon("ideal")
    try:
        done = daemon.gonio("scan", "analytic_gloss", *PLANE, "--rig", "ideal")
        assert done.returncode == 0, done.stderr
        state = daemon.state()["job"]
        assert state["kind"] == "scan" and state["progress"]["measured"] == 22
        assert "plot" in done.stdout
    finally:
        daemon.close()


def test_saturated_readings_are_no_part_of_a_mean(tmp_path, monkeypatch):
    """They are bounds: said, and left out."""
    from dataclasses import replace

    from gonio.config import Material, load_config
    from gonio.config.find import find_config
    from gonio.config.rig import RigConfig
    from gonio.run.scan import make_scan_products
    from gonio.run.start import start

    material = Material.model_validate({"name": "x", "truth": "analytic_gloss"})
    rig = load_config(find_config("ideal", "rigs"), RigConfig)
    run = start(material, rig, tmp_path / "run", scan=in_plane([30], 10, 20, 10))
    run()
    run.close()
    whole = Store.measured
    monkeypatch.setattr(Store, "measured", lambda self: replace(m := whole(self), saturated=m.id == 0))
    said = make_scan_products(tmp_path / "run")
    assert said[-1] == "note   1 readings are saturated and left out of the means"
    first, second = (tmp_path / "run" / "scan.csv").read_text().splitlines()[1:]
    assert ",,," in first and first.endswith(",0") and second.endswith(",1")
