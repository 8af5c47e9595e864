"""Geometry observations as a table: `kind, <axis>_deg of every axis, x, y, z`; x, y, z are empty for a mirror."""

import csv
from pathlib import Path

import numpy as np

from calibration.geometry import Observation
from gonio.config.rig import RigConfig
from gonio.geometry import unit
from gonio.rig.errors import CalibrationMissing

KINDS = ("mirror", "detector", "light")


def read_observations(path: Path, config: RigConfig) -> list[Observation]:
    """The observations of a CSV file. Raises CalibrationMissing that names file, line and column."""
    angles = [f"{name}_deg" for name in config.axis_names]
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as e:
        raise CalibrationMissing(f"{path}: cannot be read as text ({type(e).__name__}); give a CSV file") from None
    rows = csv.DictReader(text.splitlines())
    if missing := [c for c in ("kind", *angles) if c not in (rows.fieldnames or ())]:
        raise CalibrationMissing(f"{path}:1: no column {missing[0]}; name kind, {', '.join(angles)}, x, y, z")
    found = []
    for row in rows:
        where = f"{path}:{rows.line_num}"
        kind = row["kind"]
        if kind not in KINDS:
            raise CalibrationMissing(f"{where}: kind is {kind!r}; it must be one of {', '.join(KINDS)}")
        pose = np.radians([_number(row, column, where) for column in angles])
        if kind == "mirror":
            found.append(Observation("mirror", pose))
        else:
            direction = np.array([_number(row, column, where) for column in "xyz"])
            found.append(Observation("detector" if kind == "detector" else "light", pose, unit(direction)))
    return found


def _number(row: dict[str, str], column: str, where: str) -> float:
    try:
        value = float(row.get(column) or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise CalibrationMissing(f"{where}: {column} is {row.get(column)!r}; give a number")
    return value
