"""The house: imports run downwards, and what is not needed is not loaded."""

import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from imports import ROOT, circles, crowded, violations


def test_imports_run_downwards_only():
    assert violations() == []


def test_no_circles_and_no_crowded_rooms():
    assert circles() == [] and crowded() == []


def test_negative_control_circles_are_found(tmp_path):
    (tmp_path / "gonio" / "run").mkdir(parents=True)
    (tmp_path / "gonio" / "run" / "a.py").write_text("from gonio.run import b\n")
    (tmp_path / "gonio" / "run" / "b.py").write_text("import gonio.geometry\n")
    assert circles(tmp_path) == []
    (tmp_path / "gonio" / "run" / "b.py").write_text("def f():\n    from gonio.run.a import x\n" + "\n" * 300)
    assert len(circles(tmp_path)) == 1 and "gonio.run.a" in circles(tmp_path)[0]
    assert crowded(tmp_path) == ["gonio/run/b.py: 302 lines, 300 at most"]


def test_negative_control_an_upward_import_is_found(tmp_path):
    (tmp_path / "gonio" / "mcmc").mkdir(parents=True)
    (tmp_path / "gonio" / "mcmc" / "bad.py").write_text(
        "def f():\n    import torch\n    from gonio.run.record.store import Store\n"
    )
    (tmp_path / "sim").mkdir()
    (tmp_path / "sim" / "bad.py").write_text("import drivers.bus\n")
    found = violations(tmp_path)
    assert len(found) == 3 and any("torch" in f for f in found) and any("sim imports drivers" in f for f in found)


CALL = """
from gonio.cli import main
try:
    main()
except SystemExit as e:
    assert not e.code, e.code
"""


@pytest.mark.parametrize("what", ["import gonio", "--help", "check analytic_gloss", "materials"])
def test_heavy_packages_are_not_loaded(what):
    if what.startswith("import"):
        code = what
    else:
        code = f"import sys; sys.argv = ['gonio', *{what.split()!r}]\n" + CALL
    code += "\nimport sys\nprint([m for m in ('torch', 'cv2', 'matplotlib', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "[]"


def test_no_table_is_committed_and_no_path_of_a_machine():
    files = subprocess.run(["git", "ls-files"], capture_output=True, text=True, cwd=ROOT).stdout.split()
    if not files:
        pytest.skip("not a git checkout")
    assert not [f for f in files if f.endswith((".bsdf", ".binary"))]
