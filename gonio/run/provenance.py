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
from gonio.rig.calibration import Dated, GeometryCalibration, RadiometryCalibration, load_calibration
from gonio.rig.stale import stale
from gonio.run.truth import scene_sha256, truth_sha256


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
        "scene_sha256": scene_sha256(material),
        "calibration": json.loads(rig.calibration.model_dump_json()),
        "calibrations": _calibrations(rig),
        "stale": stale(rig) if rig.calibration.allow_stale else {},
        "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def _calibrations(rig: RigConfig) -> dict[str, Any]:
    """What the run was measured by, whole, so that its budget does not hang on files beside it."""
    files: dict[str, tuple[str | None, type[Dated]]] = {"geometry": (rig.calibration.geometry, GeometryCalibration)}
    files |= {"radiometry": (rig.calibration.radiometry, RadiometryCalibration)}
    return {
        kind: json.loads(load_calibration(Path(name), model).model_dump_json())
        for kind, (name, model) in files.items()
        if name is not None
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
