"""A study in cells. A cell is a mapping of JSON values; the function of a study makes rows of it, and of nothing else.

So what a cell gave can be kept under what it is: its own content, the function's name and the source that figures hang
on. A study that was killed goes on where it was; one whose code has changed since begins anew.
"""

import hashlib
import json
import os
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any

import gonio
from gonio.atomic import write_text

Cell = dict[str, Any]
Row = dict[str, Any]

SOURCES = ("gonio", "sim", "calibration", "drivers")  # packages whose code a figure may hang on
ASIDE = ("commands", "daemon", "api", "importing")  # rooms of gonio that no cell goes through
SUFFIXES = (".py", ".npz", ".yaml", ".xml")  # code, weights, the rigs and scenes that ship


class Kept:
    """The rows of cells that were made before, a file each, in a folder. Nothing of a cell that failed is kept."""

    def __init__(self, folder: Path, function: str):
        self.folder, self.function = folder, function
        folder.mkdir(parents=True, exist_ok=True)

    def path(self, cell: Cell) -> Path:
        return self.folder / f"{digest(self.function, cell)}.json"

    def get(self, cell: Cell) -> list[Row] | None:
        """Its rows, or None where there are none, or none of this code that can be read."""
        try:
            kept = json.loads(self.path(cell).read_text())
            return kept["rows"] if kept["source"] == source_sha256() else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def put(self, cell: Cell, rows: list[Row]) -> None:
        write_text(self.path(cell), json.dumps({"cell": cell, "source": source_sha256(), "rows": rows}))


def digest(function: str, cell: Cell) -> str:
    """A name for a cell of a function: 32 hex digits. Raises TypeError where the cell is more than JSON values."""
    text = json.dumps([function, cell], sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()[:32]


@lru_cache(maxsize=1)
def source_sha256() -> str:
    """Of the modules, weights, priors, rigs and scenes that a figure may hang on; and of GONIO_PRIOR."""
    top = Path(gonio.__file__).parent.parent
    found = hashlib.sha256()
    for package in SOURCES:
        for path in sorted((top / package).rglob("*")):
            name = path.relative_to(top)
            if path.suffix not in SUFFIXES or (name.parts[0] == "gonio" and name.parts[1] in ASIDE):
                continue
            found.update(str(name).encode() + b"\0" + path.read_bytes())
    if prior := os.environ.get("GONIO_PRIOR"):
        found.update(Path(prior).read_bytes())
    return found.hexdigest()


def called(function: str, cell: Cell) -> list[Row]:
    """`package.module:name` called with a cell: its rows, each with the cell's own keys before them."""
    module, _, name = function.partition(":")
    return [{**_flat(cell), **row} for row in getattr(import_module(module), name)(dict(cell))]


def _flat(cell: Cell) -> Row:
    """The cell's keys that a table can hold."""
    return {k: v if isinstance(v, str | int | float | bool | None) else json.dumps(v) for k, v in cell.items()}
