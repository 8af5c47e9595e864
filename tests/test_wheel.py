"""The wheel is the whole program: installed in an empty folder, everything that ships is found by its name."""

import os
import shutil
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
    assert f"rig            {rig}" in gonio(installed, "check", "analytic_gloss", "--rig", rig)


def test_every_study_is_listed(installed):
    said = gonio(installed, "bench")
    assert [line.split()[0] for line in said.splitlines()] == names("studies")


def test_a_run_from_the_wheel(installed):
    """Measured, reconstructed, exported; the flow's weights and the daemon's page are there too."""
    said = gonio(
        installed, "acquire", "analytic_gloss", "--rig", "ideal", "--out", "run", "--set", "budget.measurements=150",
        "--set", "sampler.proposal=flow", "--set", "sampler.flow.train=false",
    )  # fmt: skip
    assert "report run/report.html" in said
    site = installed[0]
    assert (site / "gonio" / "daemon" / "page" / "index.html").is_file() and (site / "gonio" / "py.typed").is_file()
