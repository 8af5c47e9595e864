"""--json: one object with the keys of docs/json.md, and the figures of the text form."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[1] / "docs" / "json.md"


def gonio(*args, cwd=None):
    command = [sys.executable, "-m", "gonio.cli", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, cwd=cwd, timeout=300)


def both(*args):
    text, data = gonio(*args), gonio(*args, "--json")
    assert text.returncode == data.returncode, data.stderr
    assert data.stdout.count("\n") == 1
    return text.stdout, json.loads(data.stdout, parse_constant=not_json)


def not_json(word):
    raise AssertionError(f"{word} is Python's, not JSON")


def documented(command: str) -> set[str]:
    """The keys that the page's section of a command names, each at the beginning of a row."""
    section = PAGE.read_text().split(f"## {command}\n")[1].split("\n## ")[0]
    return set(re.findall(r"^\| `([a-z_]+)", section, re.M))


def test_check():
    text, data = both("check", "chm_orange", "--rig", "sim", "--set", "stop.energy_error=0.03", "--set", "seed=5")
    assert set(data) == documented("check")
    said = dict(re.findall(r"^(\S+(?: \S+)*?)\s{2,}(.*)$", text, re.M))
    assert f"{data['reachable']:.1%}" in said["reachable"] and data["sampler"]["seed"] == 5
    assert f"{data['seconds']['measurement']:.2f} s" in said["a measurement"]
    assert f"about {data['rig_hours']:.1f} h for {data['budget']['measurements']} meas" in said["rig time"]
    assert str(data["stop"]["energy_error"]) in said["ends when"] and data["truth"]["origin"] in said["truth"]
    total = data["seconds"]["motion"] + data["seconds"]["settle"] + data["seconds"]["reading"]
    assert total == pytest.approx(data["seconds"]["measurement"])


def test_check_of_a_real_rig(tmp_path):
    assert gonio("init", "rig", "--no-look", cwd=tmp_path).returncode == 0
    assert gonio("init", "material", "felt", cwd=tmp_path).returncode == 0
    done = gonio("check", "felt.yaml", "--rig", "lab.yaml", "--json", cwd=tmp_path)
    assert done.returncode == 5 and not done.stdout and "gonio calibrate radiometry" in done.stderr


def test_doctor():
    text, data = both("doctor", "--rig", "sim")
    assert set(data) == documented("doctor") and data["well"] is True
    lines = [" ".join(line.split()) for line in text.splitlines()]
    said = [f["text"] if f["level"] == "note" else f"{f['level']} {f['text']}" for f in data["findings"]]
    assert said == lines


def test_doctor_of_a_rig_that_is_not_there(tmp_path):
    gonio("init", "rig", "--no-look", cwd=tmp_path)
    done = gonio("doctor", "--rig", "lab.yaml", "--json", cwd=tmp_path)
    data = json.loads(done.stdout)
    assert done.returncode == 3 and data["well"] is False
    assert {f["level"] for f in data["findings"]} <= {"ok", "warn", "FAIL"}


def test_materials():
    text, data = both("materials")
    assert set(data) == documented("materials")
    rows = [line.split(None, 1) for line in text.split("\n\n")[0].splitlines()]
    assert [(m["name"], f"{m['origin']}{': ' if m['note'] else ''}{m['note']}") for m in data["materials"]] == [
        (name, rest.strip()) for name, rest in rows
    ]
    assert all(Path(m["path"]).exists() for m in data["materials"])
    assert all(name in text for name in data["fetchable"])


@pytest.mark.slow
def test_evaluate_and_budget(tmp_path):
    done = gonio("acquire", "analytic_gloss", "--rig", "sim", "--out", tmp_path / "run", "--no-post", "--set",
                 "budget.measurements=120")  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert gonio("reconstruct", tmp_path / "run").returncode == 0
    text, data = both("evaluate", tmp_path / "run")
    assert set(data) == documented("evaluate")
    assert all(f"{k} {data[k]:.4f}" in text for k in ("energy_mean", "bright_min", "log"))
    text, data = both("budget", tmp_path / "run")
    assert set(data) == documented("budget")
    assert all(f"{v:.4f}" in text for row in data["dhr"] for v in row["value"])


def test_status_and_queue():
    from tests.daemon.conftest import Daemon

    daemon = Daemon("ideal")
    try:
        data = json.loads(daemon.gonio("status", "--json").stdout, parse_constant=not_json)
        assert set(data) == documented("status")
        text = daemon.gonio("status").stdout
        assert data["rig"]["name"] in text and data["state"] in text
        daemon.gonio("queue", "add", "analytic_gloss")
        data = json.loads(daemon.gonio("queue", "list", "--json").stdout, parse_constant=not_json)
        assert set(data) == documented("queue list")
        assert data["entries"][0]["name"] in daemon.gonio("queue", "list").stdout
    finally:
        daemon.close()
