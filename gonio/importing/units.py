"""Units in the names of columns, and values that come in another unit than they are kept in."""

import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gonio.geometry import Array
from gonio.importing import CannotImport

if TYPE_CHECKING:
    from gonio.importing.roles import Column, Mapping

ANGLES = {"deg": "degrees", "degree": "degrees", "degrees": "degrees", "°": "degrees", "rad": "radians",
          "radian": "radians", "radians": "radians"}  # fmt: skip
PLAIN = ("", "-", "1", "1/sr", "sr^-1", "sr-1", "sr⁻¹", "sr**-1", "sr^(-1", "/sr")
_BRACKET = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]+\s*$")
_NANOMETRES = re.compile(r"\d{3,4}(\.\d+)?\s*[\[(]\s*nm\s*[\])]")


def split(name: str) -> tuple[str, str]:
    """(name without its unit, lower case; degrees, radians or "")."""
    text = name.strip().lower()
    if found := _BRACKET.search(text):
        return text[: found.start()].strip(), ANGLES.get(found[1], "")
    head, _, tail = text.rpartition("_")
    return (head, ANGLES[tail]) if head and tail in ANGLES else (text, "")


def bracket(name: str) -> str:
    """What stands in brackets at the end of a name, "" where nothing does."""
    found = _BRACKET.search(name)
    return found[1].strip() if found else ""


def tristimulus(columns: Sequence["Column"]) -> list["Column"]:
    """Channels x, y, z in any case are X, Y, Z where they are all three and no other is."""
    if sorted(c.channel.lower() for c in columns if c.role == "f") != ["x", "y", "z"]:
        return list(columns)
    return [replace(c, channel=c.channel.upper()) if c.role in ("f", "sigma") else c for c in columns]


def kept(mapping: "Mapping", at: list[int], value: Array, sigma: Array, source: str) -> tuple[Array, Array, list[str]]:
    """value (N, C) and sigma (N, C) of the columns `at`, without the percents that the names give; and what was done.

    Raises CannotImport for another unit of a column that was not named by hand.
    """
    columns, said = mapping.columns, []
    for c in columns:
        _refuse_other(c, mapping.quantity, source)
    value, sigma = value.copy(), sigma.copy()
    sigma_of = {c.channel: c for c in columns if c.role == "sigma"}
    for k, c in enumerate(columns[q] for q in at):
        percent = bracket(c.name) == "%"
        if percent:
            value[:, k] /= 100
            said.append(f"{c.name}: per cent, divided by 100")
        own = sigma_of.get(c.channel, sigma_of.get(""))
        if own is None:
            continue
        if bracket(own.name) == "%":
            sigma[:, k] *= np.abs(value[:, k]) / 100
            said.append(f"{own.name}: taken as per cent of {c.name}")
        elif percent and not bracket(own.name):
            sigma[:, k] /= 100
            said.append(f"{own.name}: taken in the unit of {c.name}, divided by 100")
    return value, sigma, said


def _refuse_other(c: "Column", quantity: str | None, source: str) -> None:
    unit = bracket(c.name)
    if c.role not in ("f", "sigma") or c.how == "by hand" or unit == "%" or unit.replace(" ", "").lower() in PLAIN:
        return
    if quantity == "counts" or _NANOMETRES.fullmatch(c.name.strip().lower()):
        return
    raise CannotImport(f"{source}: {c.name}: unit {unit[:40]!r}; 1/sr, - or % expected (--column by hand takes it so)")
