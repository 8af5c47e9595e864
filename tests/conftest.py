"""Where tests find the measured materials, and one thread per process."""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]


@pytest.fixture(scope="session")
def shared_dir() -> Path:
    """The folder of measured materials and of the referee, beside the checkout; not part of the project."""
    folder = ROOT.parent / "shared"
    if not (folder / "tools" / "score.py").exists():
        pytest.skip("needs ../shared (measured materials and the referee), which is not here")
    return folder


@pytest.fixture(scope="session")
def rgl_dir(shared_dir: Path) -> Path:
    return shared_dir / "materials" / "rgl"


@pytest.fixture(scope="session")
def score(shared_dir: Path):
    """The referee's module, score.py."""
    import sys

    sys.path.insert(0, str(shared_dir / "tools"))
    import score as module

    return module
