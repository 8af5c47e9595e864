"""Directions given by hand: a list of pairs in degrees, from a table or in a plane of incidence."""

import csv
import io
import math
import os
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated

from pydantic import Field

from gonio.config.loader import ConfigError, Section

MOST, MOST_BYTES = 100_000, 20_000_000
NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d{1,3})?", re.ASCII)
COLUMNS = ("theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg")
Theta = Annotated[float, Field(ge=0, lt=90)]
Phi = Annotated[float, Field(ge=-360, le=360)]


class Scan(Section):
    """Pairs as (theta_i, phi_i, theta_o, phi_o), each measured `repeats` times: the list as a whole, then again."""

    pairs_deg: tuple[tuple[Theta, Phi, Theta, Phi], ...] = Field(min_length=1, max_length=MOST)
    repeats: int = Field(1, ge=1, le=10_000)


def in_plane(
    theta_i_deg: Sequence[float], first: float, last: float, step: float, phi_deg: float = 0.0, repeats: int = 1
) -> Scan:
    """theta_o from `first` to `last` in the plane of incidence, positive on the mirror side, at each of theta_i_deg.

    phi_deg is the azimuth of that mirror side on the sample; the light comes from the other. Raises ConfigError.
    """
    if not all(map(math.isfinite, (first, last, step, phi_deg, *theta_i_deg))):
        raise ConfigError("scan: angles must be numbers of degrees")
    if not step > 0 or not first <= last:
        raise ConfigError(f"scan: from {first:g} to {last:g} by {step:g}: wanted --from below --to, --step above 0")
    if max(abs(first), abs(last)) >= 90 or not all(0 <= t < 90 for t in theta_i_deg):
        raise ConfigError("scan: --theta-i from 0, --from and --to from -90, all below 90 degrees: above the horizon")
    count = math.floor((last - first) / step + 1e-9) + 1
    if count * len(theta_i_deg) > MOST:
        raise ConfigError(f"scan: {count * len(theta_i_deg)} pairs; {MOST} at most")
    angles = [first + k * step for k in range(count)]
    behind = math.remainder(phi_deg + 180, 360)
    pairs = [(t, behind, abs(a), phi_deg if a >= 0 else behind) for t in theta_i_deg for a in angles]
    return _checked(pairs, repeats, "scan")


def read_scan(path: str | os.PathLike[str], repeats: int = 1) -> Scan:
    """A CSV with the columns theta_i_deg, theta_o_deg and, where they are not 0 and 180, phi_i_deg, phi_o_deg.

    Other columns are left alone. Raises ConfigError naming file and line.
    """
    path = Path(path)
    try:
        if not path.is_file():
            raise ConfigError(f"{path}: not a file; name a CSV with the columns {', '.join(COLUMNS)}")
        if (size := path.stat().st_size) > MOST_BYTES:
            raise ConfigError(f"{path}: {size} bytes, {MOST_BYTES} at most; is it the right file?")
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as e:
        raise ConfigError(f"{path}: byte {e.start}: not UTF-8 text; save it as UTF-8") from None
    except OSError as e:
        raise ConfigError(f"{path}: {e.strerror or e}") from None
    return _checked(_rows(text, str(path)), repeats, str(path))


def _rows(text: str, source: str) -> list[tuple[float, ...]]:
    if "\0" in text:
        raise ConfigError(f"{source}: holds zero bytes; not a CSV")
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        head = [name.strip() for name in next(reader, [])]
        for name in ("theta_i_deg", "theta_o_deg"):
            if name not in head:
                raise ConfigError(f"{source}:1: no column {name}; wanted {', '.join(COLUMNS)}")
        if len(set(head) & set(COLUMNS)) != sum(head.count(name) for name in COLUMNS):
            raise ConfigError(f"{source}:1: a column is there twice")
        at = [head.index(name) if name in head else None for name in COLUMNS]
        out: list[tuple[float, ...]] = []
        for row in reader:
            if not any(cell.strip() for cell in row):
                continue
            if len(out) == MOST:
                raise ConfigError(f"{source}: more than {MOST} rows")
            out.append(_row(row, at, f"{source}:{reader.line_num}"))
    except csv.Error as e:
        raise ConfigError(f"{source}:{reader.line_num}: {e}") from None
    if not out:
        raise ConfigError(f"{source}: no rows; wanted a pair of directions in each")
    return out


def _row(row: list[str], at: list[int | None], where: str) -> tuple[float, ...]:
    values = []
    for name, k, missing in zip(COLUMNS, at, (None, 0.0, None, 180.0)):
        cell = row[k].strip() if k is not None and k < len(row) else ""
        if cell == "" and (missing is None or k is not None):
            raise ConfigError(f"{where}: {name}: empty")
        if cell and NUMBER.fullmatch(cell) is None:
            raise ConfigError(f"{where}: {name}: {cell[:40]!r} is not a number of degrees")
        value = float(cell) if cell else missing
        low, high = (0.0, 90.0) if name.startswith("theta") else (-360.0, 360.0)
        if value is None or not low <= value <= high or (value == 90.0 and high == 90.0):
            raise ConfigError(f"{where}: {name}: {cell[:40]} is out of range; degrees, theta from 0 to below 90")
        values.append(value)
    return tuple(values)


def _checked(pairs: Iterable[tuple[float, ...]], repeats: int, source: str) -> Scan:
    pairs = tuple(pairs)
    if any(not abs(phi) <= 360 for pair in pairs for phi in pair[1::2]):
        raise ConfigError(f"{source}: azimuths are degrees, -360 to 360")
    if not 1 <= repeats <= 10_000:
        raise ConfigError(f"{source}: {repeats} repeats; 1 to 10,000")
    return Scan(pairs_deg=pairs, repeats=repeats)  # type: ignore[arg-type]  # four numbers each, which pydantic checks
