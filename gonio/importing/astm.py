"""The text of ASTM E1392-96: header lines `KEYWORD value`, then VARS with the columns' names, then a row a reading.

Rows are separated by commas (or white space), angles in radians where none is larger than 2 pi: theta_i, phi_i to the
light, theta_s (or _r, _o), phi_s to the detector; the mirror direction is at phi_i + pi. Columns `R,G,B`, `X,Y,Z` or
`450nm` are channels. As Cornell's Program of Computer Graphics writes it and libbsdf reads it (AstmReader.cpp).
"""

import re
from dataclasses import replace
from pathlib import Path

from gonio.importing import CannotImport, Readings
from gonio.importing.delimited import Choices, TextTable, read_table
from gonio.importing.roles import DIRECTIONS, Column, Mapping, guess
from gonio.importing.text import read_lines

HEADER_LINES = 1000  # VARS comes before


def read(path: Path, choices: Choices) -> Readings:
    """Raises CannotImport."""
    lines = read_lines(path)
    at = next((k for k, line in enumerate(lines[:HEADER_LINES]) if re.match(r"\s*VARS\b", line)), None)
    if at is None:
        raise CannotImport(f"{path}: no VARS line in the first {HEADER_LINES}; is it of another kind (--format)?")
    names = [n for n in re.split(r"[\s,]+", lines[at].split("VARS", 1)[1].strip()) if n]
    rows = [line for line in lines[at + 1 :] if line.strip()]
    if not rows:
        raise CannotImport(f"{path}:{at + 1}: no rows after VARS")
    separator = "," if "," in rows[0] else " "
    # the lines before are kept empty, so that a complaint names the right one
    body = [*[""] * at, separator.join(names), *lines[at + 1 :]]
    table = TextTable(body, str(path))
    mapping = _values(guess(table.names if table.has_header else names))
    if not table.has_header or table.width != len(names):
        raise CannotImport(f"{path}:{at + 1}: VARS names {len(names)} columns, the rows have {table.width}")
    readings = read_table(table, mapping, choices, "astm")
    expected = _number_after(lines[:at], "NUM_POINTS")
    if expected is not None and expected != len(readings):
        note = f"the header says {expected} points, {len(readings)} are there"
        readings = replace(readings, said=(*readings.said, note))
    return readings


def _values(mapping: Mapping) -> Mapping:
    """What is no direction, no sigma and no mark of saturation is a channel of f: the format holds nothing else."""
    columns = [
        Column(c.name, "f", c.channel or c.name, "", "name") if c.role not in (*DIRECTIONS, "sigma", "saturated") else c
        for c in mapping.columns
    ]
    return Mapping(tuple(columns), "f")


def _number_after(lines: list[str], keyword: str) -> int | None:
    for line in lines:
        if m := re.match(rf"\s*{keyword}\s+(\d{{1,9}})\s*$", line):
            return int(m[1])
    return None
