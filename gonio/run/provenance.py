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
        "calibration": json.loads(rig.calibration.model_dump_json()),
        "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def _git() -> str:
    here = Path(gonio.__file__).parent
    try:
        done = subprocess.run(
            ["git", "-C", here, "describe", "--always", "--dirty"], capture_output=True, text=True, timeout=5
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return done.stdout.strip()
