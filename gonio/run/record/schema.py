"""What the tables of run.sqlite hold."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array

FORMAT = 1
RIG = "rig."  # keys of the rig's state in `meta`
STEP_COLUMNS = ("chain", "step", "kind", "id", "accepted", "log_q", "state", "log_p")
SCHEMA = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE measurements (
  id INTEGER PRIMARY KEY,      -- the sampler's number
  asked BLOB NOT NULL,         -- wi, wo as proposed, 6 float64
  seen BLOB NOT NULL,          -- wi, wo as achieved
  f BLOB NOT NULL,             -- C float64, 1/sr, no cosine; NaN = could not be measured
  sigma BLOB NOT NULL,
  saturated INTEGER NOT NULL,
  raw TEXT,                    -- JSON: what the detector itself said
  rig_s REAL NOT NULL,         -- rig seconds it took
  wall_s REAL NOT NULL         -- since the run began
);
CREATE TABLE steps (
  chain INTEGER, step INTEGER, kind INTEGER, id INTEGER, accepted INTEGER, log_q REAL, state INTEGER, log_p REAL,
  proposed BLOB,               -- wi, wo of a proposal that was never measured (id -1)
  PRIMARY KEY (chain, step)
) WITHOUT ROWID;
CREATE TABLE events (wall_s REAL, kind TEXT, text TEXT);
"""


# measurements that the rig itself no longer stands by, with why; of a run that began before there were any, made later
SUSPECTS = """
CREATE TABLE IF NOT EXISTS suspects (
  id INTEGER, asked BLOB, seen BLOB, f BLOB, sigma BLOB, saturated INTEGER, raw TEXT, rig_s REAL, wall_s REAL,
  reason TEXT NOT NULL
);
"""


@dataclass(frozen=True)
class Measured:
    """All measurements of a run in order of id, M of them; see the schema for units."""

    id: NDArray[np.int64]
    asked: Array  # (M, 6)
    seen: Array  # (M, 6)
    f: Array  # (M, C)
    sigma: Array
    saturated: NDArray[np.bool_]
    rig_s: Array
    wall_s: Array


def numbers(blobs: Sequence[bytes], empty_width: int) -> Array:
    """Rows of float64 from blobs of equal length."""
    return np.frombuffer(b"".join(blobs)).reshape(len(blobs), -1) if blobs else np.empty((0, empty_width))
