"""The budget of a run: what it measured, by the calibrations that it keeps."""

import json
from pathlib import Path

import numpy as np

from gonio.atomic import write_text
from gonio.budget.budget import Budget, nodes
from gonio.budget.common import Common
from gonio.geometry import Array
from gonio.load import load_brdf
from gonio.reconstruct.integrals import EDGES
from gonio.rig.calibration import GeometryCalibration, RadiometryCalibration
from gonio.run.record.config import read_config
from gonio.run.record.integrals import AlbedoOfRun
from gonio.run.record.store import Store

THETA_I = (0.0, 15.0, 30.0, 45.0, 60.0, 75.0)  # degrees


def budget_of(folder: Path) -> Budget:
    """Raises ConfigError, StoreError, BrdfFileError where it is no run, or has no BRDF yet."""
    config = read_config(folder)
    brdf = load_brdf(folder)
    with Store.open(folder, write=False) as store:
        kept = store.get("provenance", {}).get("calibrations", {})
        hours = float(store.measured().rig_s.sum()) / 3600
        found = AlbedoOfRun.of(store, config.material).found
    common = Common(
        config.rig,
        brdf.eval,
        RadiometryCalibration.model_validate(kept["radiometry"]) if "radiometry" in kept else None,
        GeometryCalibration.model_validate(kept["geometry"]) if "geometry" in kept else None,
        hours,
        config.material.plan.reference_every > 0,
        config.material.symmetry == "isotropic",
    )

    def band_errors(theta_i: float) -> Array | None:
        if found is None:
            return None
        k = int(np.clip(np.searchsorted(EDGES, theta_i, "right") - 1, 0, len(EDGES) - 2))
        return np.asarray(found.error[k] / np.maximum(found.value[k], 1e-12))

    return Budget(brdf, common, band_errors)


def write_budget(folder: Path, budget: Budget, theta_i_deg: tuple[float, ...] | None = None) -> dict:
    """budget.json in the run: relative standard uncertainties (k = 1) by part and stratum, and DHR with u."""
    wi, wo = nodes()
    found = {
        "k": 1,
        "relative": budget.by_stratum(wi, wo),
        "dhr": [
            {
                "theta_i_deg": round(float(np.degrees(r.theta_i)), 6),
                "value": r.value.tolist(),
                "u": r.u.tolist(),
                "random": r.random.tolist(),
            }
            for r in (budget.reflectance(float(np.radians(t))) for t in theta_i_deg or THETA_I)
        ],
        "left_out": budget.left_out,
    }
    write_text(Path(folder) / "budget.json", json.dumps(found, indent=1))
    return found
