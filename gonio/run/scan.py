"""A run whose directions were given by hand: what of them the rig can reach, and what is made of it when it has ended.

It is a run as any other (`reconstruct`, `report`, `export`, `resume` take it); its list lies in its provenance.
"""

import csv
from pathlib import Path

import numpy as np

from gonio.atomic import beside
from gonio.config import ConfigError, Material
from gonio.config.material import Budget, Stop
from gonio.config.rig import RigConfig
from gonio.config.scan import COLUMNS, Scan
from gonio.geometry import Array, from_angles
from gonio.rig.motion.envelope import Envelope
from gonio.run.record.config import read_config
from gonio.run.record.store import Store

SCAN = "scan"  # key of the provenance


def scan_of(store: Store) -> Scan | None:
    """The list of a run that has one."""
    found = store.get("provenance", {}).get(SCAN)
    return None if found is None else Scan.model_validate(found)


def vectors(scan: Scan) -> tuple[Array, Array]:
    """wi, wo (N, 3)."""
    theta_i, phi_i, theta_o, phi_o = np.radians(np.array(scan.pairs_deg, float)).T
    return from_angles(theta_i, phi_i), from_angles(theta_o, phi_o)


def scan_for(scan: Scan, material: Material, rig: RigConfig, envelope: Envelope) -> tuple[Scan, Material]:
    """The part of the list that the rig can reach, and the material with the budget to measure it; no other stop rule.

    Raises ConfigError where nothing is within reach.
    """
    reach = envelope.reachable(*vectors(scan))
    if not reach.any():
        raise ConfigError(
            f"scan: rig {rig.name} reaches none of the {len(reach)} pairs; see its limits and stay_out_deg"
        )
    kept = scan.model_copy(update={"pairs_deg": tuple(p for p, ok in zip(scan.pairs_deg, reach) if ok)})
    budget = Budget(measurements=len(kept.pairs_deg) * scan.repeats)
    stop = Stop(unmeasured=material.stop.unmeasured)
    return kept, material.model_copy(update={"budget": budget, "stop": stop})


def make_scan_products(folder: Path) -> list[str]:
    """scan.csv and scan.png in the run; lines that say so. Raises StoreError."""
    from gonio.render.scan import plot_scan

    channels = read_config(folder).material.channels
    with Store.open(folder, write=False) as store:
        scan, m = scan_of(store), store.measured()
    assert scan is not None
    n = len(scan.pairs_deg)
    f = np.full((max(1, -(-int(m.id.max(initial=0) + 1) // n)), n, len(channels)), np.nan)
    sigma = f.copy()
    value = ~np.asarray(m.saturated, bool)  # a saturated reading is a bound: no part of a mean
    at = m.id[value] // n, m.id[value] % n
    f[at], sigma[at] = m.f[value], m.sigma[value]
    mean, u, scatter, count = _over_passes(f, sigma)
    pairs = np.array(scan.pairs_deg)
    table = Path(folder) / "scan.csv"
    with beside(table) as part, open(part, "w", newline="", encoding="utf-8") as out:
        writer = csv.writer(out)
        writer.writerow(
            [*COLUMNS, *(f"{name}_{c}" for name in ("f", "sigma", "scatter") for c in channels), "readings"]
        )
        for k, pair in enumerate(pairs.tolist()):
            numbers = [*mean[k].tolist(), *u[k].tolist(), *scatter[k].tolist()]
            writer.writerow([*pair, *("" if v != v else repr(v) for v in numbers), int(count[k])])
    picture = Path(folder) / "scan.png"
    with beside(picture) as part:
        plot_scan(pairs, mean, u, channels).savefig(part, dpi=120)
    short = int((count < scan.repeats).sum())
    missing = [f"note   {short} of {n} pairs have fewer than {scan.repeats} readings"] * (short > 0)
    if bounds := int((~value).sum()):
        missing.append(f"note   {bounds} readings are saturated and left out of the means")
    return [f"table  {table}", f"plot   {picture}", *missing]


def _over_passes(f, sigma):
    """Of f, sigma (R, N, C): mean, its sigma, and the scatter of one reading about it, (N, C); readings (N,)."""
    good = np.isfinite(f)
    count = good.sum(0)
    some = np.maximum(count, 1)
    mean = np.where(count > 0, np.where(good, f, 0).sum(0) / some, np.nan)
    u = np.where(count > 0, np.sqrt(np.where(good, sigma**2, 0).sum(0)) / some, np.nan)
    off = np.where(good, (f - mean) ** 2, 0).sum(0)
    scatter = np.where(count > 1, np.sqrt(off / np.maximum(count - 1, 1)), np.nan)
    return mean, u, scatter, count.min(1)
