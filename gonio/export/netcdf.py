"""Chains as NetCDF-4 in ArviZ's layout: `arviz.from_netcdf(path)` opens it."""

import os
from pathlib import Path

import numpy as np

from gonio.atomic import beside
from gonio.brdf import Brdf
from gonio.export.about import About
from gonio.export.extra import needs
from gonio.export.intervals import Shared, columns
from gonio.geometry import to_half_diff
from gonio.run.record.store import Store


def chain_arrays(store: Store, brdf: Brdf | None = None, shared: Shared | None = None) -> dict[str, np.ndarray]:
    """The chains' states, each (chains, steps): theta_h, theta_d, phi_d, f_*, accepted, log_p, kind; equal lengths.

    Steps before every chain had found the support are left out. Of a BRDF that knows them, its value, standard
    deviation and intervals there.
    """
    m, s = store.measured(), store.steps()
    keep = s["step"] >= 0
    chains = int(s["chain"][keep].max(initial=-1)) + 1
    length = int(np.bincount(s["chain"][keep], minlength=max(chains, 1)).min()) if chains else 0

    def grid(column):
        return (
            np.stack([column[keep & (s["chain"] == c)][:length] for c in range(chains)]) if chains else np.empty((0, 0))
        )

    state = grid(s["state"])
    begin = int((state < 0).sum(1).max(initial=0))
    row = np.searchsorted(m.id, state[:, begin:])
    theta_h, _, theta_d, phi_d = (
        to_half_diff(m.asked[row, :3], m.asked[row, 3:]) if row.size else (np.empty(row.shape),) * 4
    )
    out = {"theta_h": theta_h, "theta_d": theta_d, "phi_d": np.abs(phi_d)}
    if row.size:
        out |= {f"f_{c}": m.f[row, c] for c in range(m.f.shape[1])}
        out |= dict(columns(brdf, m.asked[row, :3], m.asked[row, 3:], shared))
    return out | {k: grid(s[k])[:, begin:] for k in ("accepted", "log_p", "kind")}


def write_netcdf(
    store: Store,
    path: str | os.PathLike[str],
    brdf: Brdf | None = None,
    shared: Shared | None = None,
    about: About | None = None,
) -> Path:
    """Groups `posterior` (the states) and `sample_stats` (accepted, lp, kind); `about` as their attributes.

    Raises MissingExtra without h5netcdf.
    """
    xarray = needs("xarray", "study")
    needs("h5netcdf", "study")
    arrays = chain_arrays(store, brdf, shared)
    path = Path(path)
    stats = {"accepted": arrays.pop("accepted"), "lp": arrays.pop("log_p"), "kind": arrays.pop("kind")}
    known = {key: str(value) if isinstance(value, bool) else value for key, value in (about or {}).items()}
    with beside(path) as part:
        for mode, group, columns in (("w", "posterior", arrays), ("a", "sample_stats", stats)):
            data = xarray.Dataset({k: (("chain", "draw"), v) for k, v in columns.items()}, attrs=known)
            data.to_netcdf(part, mode=mode, group=group, engine="h5netcdf")
    return path
