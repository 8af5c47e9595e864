"""Rows of the CSV files that people write for a calibration; what is wrong in one is named by file, line and column."""

import csv
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from gonio.rig.errors import CalibrationMissing


def read_rows(path: Path, needed: Sequence[str], all_of_them: str) -> Iterator[tuple[str, dict[str, str]]]:
    """("file:line", row) of each. Raises CalibrationMissing for no text, or a column of `needed` that is not there."""
    try:
        rows = csv.DictReader(path.read_text(encoding="utf-8-sig").splitlines())
    except (OSError, UnicodeDecodeError) as e:
        raise CalibrationMissing(f"{path}: cannot be read as text ({type(e).__name__}); give a CSV file") from None
    if missing := [c for c in needed if c not in (rows.fieldnames or ())]:
        raise CalibrationMissing(f"{path}:1: no column {missing[0]}; name {all_of_them}")
    for row in rows:
        yield f"{path}:{rows.line_num}", row


def number(row: dict[str, str], column: str, where: str, remedy: str = "give a number") -> float:
    """A finite number. Raises CalibrationMissing."""
    try:
        value = float(row.get(column) or "")
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise CalibrationMissing(f"{where}: {column} is {row.get(column)!r}; {remedy}")
    return value
