"""The step log as a table: csv or parquet, one row per step, measured or free."""

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gonio.atomic import beside, write_text
from gonio.brdf import Brdf
from gonio.export.about import About
from gonio.export.intervals import Shared, columns
from gonio.geometry import to_angles
from gonio.mcmc.proposals import KINDS
from gonio.run.record.store import Store


def step_table(store: Store, brdf: Brdf | None = None, shared: Shared | None = None) -> dict[str, NDArray]:
    """Columns by name: chain, step, kind, measured, accepted, repeats, log_q, angles in degrees, f_*, sigma_*, …
    and, of a BRDF that knows them, its value, standard deviation and intervals there; of a calibrated rig also
    u_shared_*, what all readings may be off by together, relative (k = 1).

    Directions are as achieved where measured, as proposed where free. repeats counts the steps a chain stayed on this
    state, 0 if it was never there.
    """
    m, s = store.measured(), store.steps()
    measured = s["id"] >= 0
    row = np.clip(np.searchsorted(m.id, s["id"]), 0, max(len(m.id) - 1, 0))
    channels = m.f.shape[1]
    measured &= (m.id[row] == s["id"]) if len(m.id) else False
    where = np.where(measured[:, None], m.seen[row] if len(m.id) else 0.0, s["proposed"])
    (theta_i, phi_i), (theta_o, phi_o) = (to_angles(where[:, k : k + 3]) for k in (0, 3))

    def of(column):
        return np.where(measured, column[row] if len(m.id) else np.nan, np.nan)

    table: dict[str, NDArray] = {
        "chain": s["chain"],
        "step": s["step"],
        "kind": np.array(KINDS)[s["kind"]],
        "measured": measured.astype(int),
        "accepted": s["accepted"].astype(int),
        "repeats": repeats(s["chain"], s["step"], s["accepted"]),
        "log_q": s["log_q"],
    }
    for name, angle in (("theta_i", theta_i), ("phi_i", phi_i), ("theta_o", theta_o), ("phi_o", phi_o)):
        table[f"{name}_deg"] = np.degrees(angle)
    table |= {f"f_{c}": of(m.f[:, c]) for c in range(channels)}
    table |= {f"sigma_{c}": of(m.sigma[:, c]) for c in range(channels)}
    table["saturated"] = (measured & m.saturated[row]).astype(int) if len(m.id) else measured.astype(int)
    table |= {"rig_s": of(m.rig_s), "wall_s": of(m.wall_s)}
    return table | dict(columns(brdf, where[:, :3], where[:, 3:], shared))


def repeats(chain: NDArray, step: NDArray, accepted: NDArray) -> NDArray[np.int64]:
    """Steps each accepted state lasted, rows ordered by chain and step."""
    out = np.zeros(len(step), np.int64)
    for c in np.unique(chain):
        rows = np.flatnonzero((chain == c) & (step >= 0))
        moves = rows[accepted[rows]]
        if len(moves):
            out[moves] = np.diff(np.append(step[moves], step[rows[-1]] + 1))
    return out


def write_csv(
    store: Store,
    path: str | os.PathLike[str],
    brdf: Brdf | None = None,
    shared: Shared | None = None,
    about: About | None = None,
) -> Path:
    """Numbers with 17 digits, so that they read back to the bit; NaN is empty.

    A table of numbers has no place for what is known of the sample: that lies beside it as PATH-metadata.json, where
    the W3C's "Model for Tabular Data and Metadata on the Web" (section 5.2) looks for it; none where nothing is known.
    """
    import csv
    import json

    table = step_table(store, brdf, shared)
    path = Path(path)
    texts = [[_text(v) for v in column.tolist()] for column in table.values()]
    with beside(path) as part, open(part, "w", newline="") as out:
        writer = csv.writer(out)
        writer.writerow(table)
        writer.writerows(zip(*texts))
    if about and set(about) != {"name"}:
        said = {"@context": "http://www.w3.org/ns/csvw", "url": path.name, "notes": [dict(about)]}
        write_text(path.with_name(f"{path.name}-metadata.json"), json.dumps(said, ensure_ascii=False, indent=1))
    return path


def write_parquet(
    store: Store,
    path: str | os.PathLike[str],
    brdf: Brdf | None = None,
    shared: Shared | None = None,
    about: About | None = None,
) -> Path:
    """The same table in Parquet, with `about` in its schema's metadata. Raises MissingExtra without pyarrow."""
    from gonio.export.extra import needs

    pyarrow = needs("pyarrow", "study")
    parquet = needs("pyarrow.parquet", "study")
    path = Path(path)
    with beside(path) as part:
        table = pyarrow.table(step_table(store, brdf, shared))
        known = {key: str(value) for key, value in (about or {}).items()}
        parquet.write_table(table.replace_schema_metadata(known), part)
    return path


def _text(value) -> str:
    if isinstance(value, float):
        return "" if value != value else repr(value)
    return str(value)
