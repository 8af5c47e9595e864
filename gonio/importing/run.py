"""Readings -> a run folder, marked as imported: what was in the file, how it was taken, and what was left out."""

import hashlib
import os
import platform
import re
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import gonio
from gonio.atomic import folder_beside
from gonio.config import ConfigError, Material, load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.importing import QUANTITIES, CannotImport, Readings
from gonio.importing.doubt import Doubts, doubts, turns_with_sample
from gonio.importing.pab import files_of
from gonio.mcmc.chain.steps import Steps
from gonio.mcmc.proposals import IMPORTED
from gonio.run.record.config import Imported, RunConfig, dump
from gonio.run.record.folder import refuse_folder
from gonio.run.record.store import Store

LOWEST = np.cos(np.radians(89.9))  # z of a direction: below, it is at the horizon
XYZ_TO_RGB = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
CHUNK = 10_000


@dataclass(frozen=True)
class Taken:
    """Readings as a run keeps them: wi, wo (M, 3), f, sigma (M, C) in 1/sr; what was found on the way; doubts of it."""

    wi: Array
    wo: Array
    f: Array
    sigma: Array
    channels: tuple[str, ...]
    quantity: str
    isotropic: bool
    said: tuple[str, ...]
    doubts: Doubts


def take(readings: Readings, *, quantity: str | None, scale: float | None, symmetry: str | None) -> Taken:
    """f of all usable readings. quantity, symmetry: None = as the file says, as is seen. Raises CannotImport."""
    quantity = quantity or readings.quantity
    if not quantity:
        known = ", ".join(f"{k} ({v})" for k, v in QUANTITIES.items())
        raise CannotImport(f"what the values are is not said in the file; say by --value one of {known}")
    if quantity == "counts" and scale is None:
        raise CannotImport("counts need --scale S, with f cos(theta_o) = S counts; a white reference tells it")
    factor = (scale or 1.0) / (np.pi if quantity == "factor" else 1.0)
    value, channels, said = readings.value, readings.channels, list(readings.said)
    usable = np.isfinite(readings.wi).all(1) & np.isfinite(readings.wo).all(1) & np.isfinite(value).all(1)
    lowest = np.minimum(readings.wi[:, 2], readings.wo[:, 2])
    up = usable & (lowest > LOWEST)
    below = int((usable & (lowest < 0)).sum())
    wi, wo, value = readings.wi[up], readings.wo[up], value[up]
    sigma = np.zeros_like(value) if readings.sigma is None else readings.sigma[up]
    cosine = wo[:, 2:] if quantity in ("f_cos", "counts") else 1.0
    f, sigma = value * factor / cosine, sigma * abs(factor) / cosine
    if channels == ("X", "Y", "Z"):
        f, sigma, channels = f @ XYZ_TO_RGB.T, np.sqrt(sigma**2 @ (XYZ_TO_RGB**2).T), ("R", "G", "B")
        said.append("CIE X, Y, Z are turned into linear sRGB")
    said += _counted(~usable, below, int((usable & ~up).sum()) - below, f, sigma, len(readings))
    sigma = np.where(np.isfinite(sigma) & (sigma >= 0), sigma, 0.0)
    if not up.any():
        raise CannotImport(f"none of {len(readings)} readings is usable: {'; '.join(said)}")
    if not np.isfinite(f).all() or np.abs(f).max() > 1e12:
        raise CannotImport(f"values up to {np.nanmax(np.abs(f)):.3g} 1/sr are no BRDF; check --value, --scale")
    if symmetry is None and readings.symmetry is not None:
        isotropic = readings.symmetry == "isotropic"
        said.append(f"taken as {readings.symmetry}, as the file says (--symmetry for the other)")
    elif symmetry is None:
        isotropic = not turns_with_sample(wi, wo, f)
        said.append(f"taken as {'isotropic' if isotropic else 'anisotropic'} (--symmetry for the other)")
    else:
        isotropic = symmetry == "isotropic"
    found = doubts(wi, wo, f, below, quantity, isotropic)
    found = replace(found, lines=(*readings.doubts, *found.lines))
    said += found.notes
    return Taken(wi, wo, f, sigma, channels, quantity, isotropic, tuple(said), found)


def _counted(unknown, below: int, at_horizon: int, f: Array, sigma: Array, n: int) -> list[str]:
    rows = [
        (int(unknown.sum()), "have no value or no direction (NaN) and are left out"),
        (below, "have a direction below the horizon and are left out"),
        (at_horizon, "have a direction at the horizon (within 0.1 degree) and are left out"),
        (int((f < 0).any(1).sum()), "have a negative value; they are kept, as dark subtraction makes them"),
        (int((f == 0).all(1).sum()), "are exactly 0"),
        (int((~np.isfinite(sigma) | (sigma < 0)).any(1).sum()), "have no usable sigma and are taken as free of noise"),
    ]
    return [f"{count} of {n} readings {what}" for count, what in rows if count]


def write_run(out: Path, taken: Taken, readings: Readings, paths: list[Path], name: str | None) -> None:
    """The run folder, whole or not at all. Raises StoreError where it cannot be made, ConfigError."""
    refuse_folder(out)
    out.parent.mkdir(parents=True, exist_ok=True)
    files = [f for p in paths for f in (files_of(p) if p.is_dir() else [p])]
    imported = Imported(
        files=tuple(p.name for p in files),
        sha256=tuple(_sha256(p) for p in files),
        format=readings.format,
        quantity=taken.quantity,
        mapping=readings.mapping,
        said=(*taken.said, *(f"doubt: {line}" for line in taken.doubts.lines)),
    )
    config = RunConfig(material=_material(taken, name or paths[0].stem), rig=_rig(), imported=imported)
    with folder_beside(out) as part:
        inner = part / "run"
        with Store.create(inner, dump(config), _provenance(imported), commit_interval=1e9, power_safe=False) as store:
            _fill(store, taken)
            store.put("ended", f"imported {len(taken.f)} readings")
            store.event("imported", f"gonio {gonio.__version__}, {', '.join(imported.files[:3])} as {readings.format}")
            for line in imported.said:
                store.event("import", line)
        for path in list(inner.iterdir()):
            os.rename(path, part / path.name)
        inner.rmdir()


def _fill(store: Store, t: Taken) -> None:
    n = len(t.f)
    both = np.concatenate([t.wi, t.wo], 1)
    saturated, no_time = np.zeros(n, bool), np.zeros(n)
    for first in range(0, n, CHUNK):
        part = slice(first, min(first + CHUNK, n))
        store.add(
            range(part.start, part.stop),
            both[part],
            both[part],
            t.f[part],
            t.sigma[part],
            saturated[part],
            [],
            no_time[part],
        )
    ids = np.arange(n)
    zero, none, nan = np.zeros(n, np.int32), np.full(n, -1), np.full(n, np.nan)
    kind = np.full(n, IMPORTED, np.int8)
    store.add_steps(Steps(zero, ids - n, kind, ids, np.zeros(n, bool), nan, none, nan, t.wi, t.wo))


def _material(t: Taken, name: str) -> Material:
    clean = re.sub(r"[^A-Za-z0-9_.-]+", "_", name).lstrip("_.-")[:100] or "imported"
    channels = tuple(str(c)[:60] for c in t.channels)
    budget = {"measurements": len(t.f)}
    symmetry = "isotropic" if t.isotropic else "anisotropic"
    return Material.model_validate({"name": clean, "channels": channels, "budget": budget, "symmetry": symmetry})


def _rig() -> RigConfig:
    """No rig measured it for gonio; the ideal one stands in its place, for it adds nothing."""
    return load_config(find_config("ideal", "rigs"), RigConfig, ["name=imported"])


def _provenance(imported: Imported) -> dict:
    return {
        "gonio": gonio.__version__,
        "git": "",
        "python": platform.python_version(),
        "numpy": np.__version__,
        "host": platform.node(),
        "seed": 0,
        "simulated": False,
        "rig": "imported",
        "depth": "imported",
        "truth": "",
        "truth_sha256": "",
        "calibration": {},
        "calibrations": {},
        "stale": {},
        "started": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "imported": imported.model_dump(mode="json"),
    }


def _sha256(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError as e:
        raise ConfigError(f"{path}: {e.strerror or e}") from None
