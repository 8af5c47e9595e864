"""Values that come in another unit than they are kept in, as the names of their columns say."""

import re

import numpy as np

from gonio.geometry import Array
from gonio.importing import CannotImport
from gonio.importing.columns.names import bracket
from gonio.importing.roles import Column, Mapping

PLAIN = ("", "-", "1", "1/sr", "sr^-1", "sr-1", "sr⁻¹", "sr**-1", "sr^(-1", "/sr")
_NANOMETRES = re.compile(r"\d{3,4}(\.\d+)?\s*[\[(]\s*nm\s*[\])]")


def kept(mapping: Mapping, at: list[int], value: Array, sigma: Array, source: str) -> tuple[Array, Array, list[str]]:
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


def _refuse_other(c: Column, quantity: str | None, source: str) -> None:
    unit = bracket(c.name)
    if c.role not in ("f", "sigma") or c.how == "by hand" or unit == "%" or unit.replace(" ", "").lower() in PLAIN:
        return
    if quantity == "counts" or _NANOMETRES.fullmatch(c.name.strip().lower()):
        return
    raise CannotImport(f"{source}: {c.name}: unit {unit[:40]!r}; 1/sr, - or % expected (--column by hand takes it so)")
