"""The budget of a run: what it measured, by the calibrations that it keeps."""

import json
from pathlib import Path

import numpy as np

from gonio.atomic import write_text
from gonio.budget.budget import Budget, medians, nodes
from gonio.budget.common import Common
from gonio.budget.readings import random_parts
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

    return Budget(brdf, common, band_errors, imported=config.imported is not None)


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
                "u": _known(r.u),
                "random": _known(r.random),
            }
            for r in (budget.reflectance(float(np.radians(t))) for t in theta_i_deg or THETA_I)
        ],
        "of_angles": medians(budget.common.of_angles(wi, wo), budget.brdf, wi, wo),
        "of_each_reading": _of_each_reading(folder, budget),
        "left_out": budget.left_out,
    }
    write_text(Path(folder) / "budget.json", json.dumps(found, indent=1))
    return found


def _of_each_reading(folder: Path, budget: Budget) -> dict[str, dict[str, float]]:
    """Medians of the random parts over the run's own readings; nothing of a camera, whose frames say it otherwise."""
    config = read_config(folder).rig
    if config.detector == "camera":
        return {}
    with Store.open(folder, write=False) as store:
        m, raw = store.measured(), raw_by_id(store)
    good = np.isfinite(m.f).all(1) & (m.f > 0).all(1) & np.array(["full_scale" in r for r in raw], bool)
    if not good.any():
        return {}
    known = budget.common.radiometry
    gain = np.full(m.f.shape[1], np.pi / config.exposure_s) if known is None else np.array(known.gain)
    wi, wo = m.seen[good, :3], m.seen[good, 3:]
    kept = [r for r, g in zip(raw, good) if g]
    return medians(random_parts(kept, wi, wo, m.f[good], m.sigma[good], gain, config), budget.brdf, wi, wo)


def raw_by_id(store: Store) -> list[dict]:
    """What the detector said of each measurement, in the order of `Store.measured`."""
    m, made = store.measured(), store.raw()
    raw: list[dict] = [{}] * len(made)
    for row, said in zip(np.lexsort((m.id, m.wall_s)), made):  # `Store.raw` has them as they were made
        raw[row] = said
    return raw


def _known(values: Array) -> list[float | None]:
    """As JSON has them: null where nobody knows."""
    return [float(v) if np.isfinite(v) else None for v in values]
