"""MERL tables: bins spread evenly over (theta_h, theta_d, phi_d), each read at its middle; holes are left out.

The table itself is `gonio.brdf.tables.merl` (Matusik et al. 2003). All of its 1.5 million bins are more than any fit
needs: a low-discrepancy sequence (R3: Roberts 2018, powers of the root of x^4 = x + 1) picks some.
"""

from pathlib import Path

import numpy as np

from gonio.brdf.base import BrdfFileError
from gonio.brdf.tables.merl import SHAPE, SIZE, read_merl
from gonio.geometry import above_horizon, from_half_diff
from gonio.importing import CannotImport, Readings

ENTRIES = 20_000
ROOT = 1.2207440846057596


def read(path: Path, entries: int = ENTRIES) -> Readings:
    """Up to `entries` bins above the horizon. Raises CannotImport."""
    try:
        if path.stat().st_size > SIZE:
            raise CannotImport(f"{path}: has {path.stat().st_size} bytes, a MERL file has {SIZE}")
        with path.open("rb") as stream:
            table = read_merl(stream, str(path))
    except OSError as e:
        raise CannotImport(f"{path}: {e.strerror or e}; name a MERL table") from None
    except BrdfFileError as e:
        raise CannotImport(str(e)) from None
    where = _spread(entries)
    h, d, p = (np.unravel_index(where, SHAPE)[k] + 0.5 for k in range(3))
    theta_h = np.pi / 2 * (h / SHAPE[0]) ** 2
    wi, wo = from_half_diff(theta_h, np.zeros_like(theta_h), d / SHAPE[1] * np.pi / 2, p / SHAPE[2] * np.pi)
    value = table.reshape(3, -1)[:, where].T
    up, known = above_horizon(wi, wo), (value >= 0).all(1)
    said = [f"{len(where)} of {table[0].size} bins, spread evenly (--entries for more)"]
    if holes := int((up & ~known).sum()):
        said.append(f"{holes} of them were never measured and are left out")
    keep = up & known
    if not keep.any():
        raise CannotImport(f"{path}: no bin above the horizon holds a value")
    mapping = {"bins": "theta_h, theta_d, phi_d at the middle", "values": "f"}
    return Readings(wi[keep], wo[keep], value[keep], None, ("R", "G", "B"), "f", "merl", mapping, tuple(said))


def _spread(entries: int) -> np.ndarray:
    """Flat numbers of different bins, about `entries` of those above the horizon (two thirds are)."""
    total = int(np.prod(SHAPE))
    n = min(int(1.5 * entries), 4 * total)
    k = np.arange(1, n + 1)[:, None]
    u = (0.5 + k * ROOT ** -np.arange(1.0, 4)) % 1
    index = np.minimum((u * SHAPE).astype(np.int64), np.array(SHAPE) - 1)
    return np.unique(np.ravel_multi_index(tuple(index.T), SHAPE))
