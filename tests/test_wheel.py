"""The wheel is the whole program: installed in an empty folder, everything that ships is found by its name."""

import json
import os
import shutil
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
NOT_SOURCE = (".venv", ".git", "build", "dist", "runs", "*.egg-info", "__pycache__", ".mypy_cache", ".ruff_cache")


def names(kind: str) -> list[str]:
    return sorted(p.stem for p in (ROOT / "configs" / kind).glob("*.yaml"))


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """A folder into which the wheel was installed, and an empty one to work in."""
    base = tmp_path_factory.mktemp("wheel")
    shutil.copytree(ROOT, base / "source", symlinks=True, ignore=shutil.ignore_patterns(*NOT_SOURCE))
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    build = [*pip, "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", base / "dist", base / "source"]
    subprocess.run(build, check=True, capture_output=True, timeout=300)
    (wheel,) = (base / "dist").glob("*.whl")
    install = [*pip, "install", "-q", "--no-deps", "--no-index", "--target", base / "site", wheel]
    subprocess.run(install, check=True, capture_output=True, timeout=300)
    (base / "empty").mkdir()
    # somebody else's repository, which the program is not of
    subprocess.run(["git", "init", "-q", base], check=True)
    commit = ["-c", "user.name=a", "-c", "user.email=a@b", "commit", "-q", "--allow-empty", "-m", "theirs"]
    subprocess.run(["git", "-C", base, *commit], check=True)
    return base / "site", base / "empty"


def gonio(installed, *args):
    site, empty = installed
    env = {k: v for k, v in os.environ.items() if k != "GONIO_MATERIALS"}
    env |= {"PYTHONPATH": str(site), "XDG_CACHE_HOME": str(empty / "cache"), "OMP_NUM_THREADS": "1"}
    code = (
        "import sys, gonio.cli, gonio, drivers, sim, calibration\n"
        f"assert all(m.__file__.startswith({str(site)!r}) for m in (gonio, drivers, sim, calibration))\n"
        f"sys.argv = ['gonio', *{[str(a) for a in args]!r}]\ngonio.cli.main()"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, cwd=empty, env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("material", names("materials"))
def test_every_material_is_found(installed, material):
    assert f"material       {material}" in gonio(installed, "check", material)


@pytest.mark.parametrize("rig", [r for r in names("rigs") if r != "bench"])
def test_every_rig_is_found(installed, rig):
    material = "grey_gloss" if rig == "picoammeter" else "analytic_gloss"  # its detector has one channel
    assert f"rig            {rig}" in gonio(installed, "check", material, "--rig", rig)


def test_the_drivers_that_ship_are_entry_points(installed):
    """A wheel offers them as a plug-in's does."""
    from gonio.config.plugins import SHIPPED

    code = (
        "import json, sys; from importlib.metadata import distributions\n"
        "offered = [e for d in distributions(path=[sys.argv[1]]) for e in d.entry_points]\n"
        "found = [e for e in offered if e.group.startswith('gonio.')]\n"
        "print(json.dumps([[e.group, e.name, e.value, e.load().Config.__name__] for e in found]))"
    )
    site, empty = installed
    command = [sys.executable, "-c", code, site]
    said = subprocess.run(
        command, cwd=empty, env={**os.environ, "PYTHONPATH": str(site)}, capture_output=True, text=True, timeout=120
    )
    assert said.returncode == 0, said.stderr
    found = {(group, name, value) for group, name, value, _ in json.loads(said.stdout)}
    assert found == {(g, n, v) for g, known in SHIPPED.items() for n, v in known.items()}


def test_every_study_is_listed(installed):
    said = gonio(installed, "bench")
    assert [line.split()[0] for line in said.splitlines()] == names("studies")


def test_every_study_opens(installed):
    """Its module is there and its file is what the module takes."""
    code = (
        "import sys; from gonio.bench.runner import *; from gonio.config.find import find_config\n"
        f"for name in {names('studies')!r}:\n"
        "    path = find_config(name, 'studies'); kind = yaml.safe_load(path.read_text())['study']\n"
        "    load_config(path, import_module(STUDIES[kind]).Config)\n"
        "    print(path)"
    )
    site, empty = installed
    env = {**os.environ, "PYTHONPATH": str(site)}
    said = subprocess.run([sys.executable, "-c", code], cwd=empty, env=env, capture_output=True, text=True, timeout=300)
    assert said.returncode == 0, said.stderr
    assert all(Path(line).is_relative_to(site) for line in said.stdout.splitlines())


def test_short_help_version_and_materials(installed):
    for words in (["-h"], ["acquire", "-h"], ["calibrate", "camera", "-h"]):
        assert gonio(installed, *words).startswith("Usage:")
    assert gonio(installed, "--version").startswith("gonio ")
    listed = {line.split()[0] for line in gonio(installed, "materials").splitlines() if line.strip()}
    assert set(names("materials")) <= listed


def test_the_wheel_holds_what_the_source_tree_holds(installed):
    """Every file of the packages that git knows, code or not."""
    kept = subprocess.run(["git", "-C", ROOT, "ls-files", "gonio", "drivers", "sim", "calibration", "configs"],
                          capture_output=True, text=True)  # fmt: skip
    if kept.returncode:
        pytest.skip("not a clone")
    here = [f"gonio/{name}" if name.startswith("configs/") else name for name in kept.stdout.split()]
    missing = [n for n in here if n != "gonio/configs" and not (installed[0] / n).exists() and (ROOT / n).exists()]
    assert not missing


def test_the_first_files_are_written_and_load(installed):
    gonio(installed, "init", "material", "mine", "--truth", "analytic_gloss", "--force")
    assert "material       mine" in gonio(installed, "check", "mine.yaml", "--rig", "ideal")
    gonio(installed, "init", "rig", "mine_rig", "--no-look", "--force")
    assert (installed[1] / "mine_rig.yaml").read_text().startswith("# Rig mine_rig")


def test_python_from_the_wheel(installed):
    """A script measures a function of its own; a type checker finds the names."""
    site, empty = installed
    code = (
        "import gonio, numpy as np\n"
        "with gonio.open_rig('ideal', truth=lambda wi, wo: 0.3 + 0 * wi[:, :1]) as rig:\n"
        "    keys = {'channels': ['L'], 'budget': {'measurements': 30}}\n"
        "    run = gonio.acquire(gonio.Material(name='grey', **keys), rig, 'grey')\n"
        "print(gonio.__file__, len(run.samples), np.ptp(run.samples.f))"
    )
    env = {**os.environ, "PYTHONPATH": str(site), "OMP_NUM_THREADS": "1"}
    said = subprocess.run([sys.executable, "-c", code], cwd=empty, env=env, capture_output=True, text=True, timeout=300)
    assert said.returncode == 0, said.stderr
    assert said.stdout.split() == [str(site / "gonio" / "__init__.py"), "30", "0.0"]
    assert (site / "gonio" / "__init__.pyi").is_file()


@pytest.mark.slow
def test_a_run_from_the_wheel(installed):
    """Measured, reconstructed, exported; the flow's weights and the daemon's page are there too."""
    said = gonio(
        installed, "acquire", "analytic_gloss", "--rig", "ideal", "--out", "run", "--set", "budget.measurements=150",
        "--set", "sampler.proposal=flow", "--set", "sampler.flow.train=false",
    )  # fmt: skip
    assert "report run/report.html" in said
    site, empty = installed
    with sqlite3.connect(empty / "run" / "run.sqlite") as db:
        (text,) = db.execute("SELECT value FROM meta WHERE key = 'provenance'").fetchone()
    assert json.loads(text)["git"] == ""
    assert (site / "gonio" / "daemon" / "page" / "index.html").is_file() and (site / "gonio" / "py.typed").is_file()
