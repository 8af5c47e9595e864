"""What it takes to say later how a run was made."""

import json
import platform
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np

import gonio
from gonio.config import Material
from gonio.config.rig import RigConfig
from gonio.run.truth import truth_sha256


def provenance(material: Material, rig: RigConfig, origin: str) -> dict[str, Any]:
    """Versions, seed, host, rig and calibrations; origin: where the truth of a simulated rig was found."""
    return {
        "gonio": gonio.__version__,
        "git": _git(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "host": platform.node(),
        "seed": material.seed,
        "simulated": rig.depth != "real",
        "rig": rig.name,
        "depth": rig.depth,
        "truth": origin,
        "truth_sha256": truth_sha256(material),
        "calibration": json.loads(rig.calibration.model_dump_json()),
        "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def _git() -> str:
    """The state of the source tree; "" for an installed gonio, whatever repository its environment lies in."""
    root = Path(gonio.__file__).resolve().parents[1]
    if not (root / ".git").exists():
        return ""
    command = ["git", "-C", str(root), "describe", "--always", "--dirty"]
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=5).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return ""
