"""CSV, TSV, parquet and columns without a header -> named columns of numbers -> readings, by a mapping of columns.

Separators (comma, semicolon, tab, white space) and decimal commas are seen from the first rows. Lines before the
header that begin with #, % or ; are comments. An empty field is NaN.
"""

import csv
import io
import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from gonio.geometry import Array
from gonio.importing import CannotImport, Readings
from gonio.importing import directions as d
from gonio.importing.columns.repeats import overlooked, varying
from gonio.importing.columns.units import kept
from gonio.importing.roles import HALF, SPHERICAL, VECTORS, Mapping, checked
from gonio.importing.text import MOST_BYTES, MOST_CHANNELS, channel_names, read_bytes, read_lines

CHUNK = 20_000  # rows turned into numbers at a time
LOOKED_AT = 50  # rows from which separators are seen
DEGREES_ABOVE = 2 * np.pi + 0.01  # an angle larger than this is in degrees


@dataclass(frozen=True)
class Choices:
    """What the user said about a table, None where nothing: unit of the angles, azimuth (degrees, 0 or 180) at which
    the mirror direction lies in the file's convention."""

    unit: str | None = None
    specular_deg: float | None = None


class TextTable:
    """Columns of a text file by name. names are of the header, "" where there is none."""

    def __init__(self, lines: list[str], source: str):
        self.source = source
        first = next((k for k, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%;"), None)
        if first is None:
            raise CannotImport(f"{source}: no rows in it")
        sample = [line for line in lines[first : first + LOOKED_AT] if line.strip()]
        self.separator = _separator(sample)
        self.comma = self.separator != "," and any(re.search(r"\d,\d", line) for line in sample[1:])
        head = next(self._rows(sample))
        self.has_header = not all(_is_number(word, self.comma) for word in head if word)
        names = [word.strip() for word in head] if self.has_header else []
        self.width = len(head)
        if len(set(names)) < len(names):
            twice = next(n for n in names if names.count(n) > 1)
            raise CannotImport(f"{source}:{first + 1}: two columns are named {twice!r}; rename one")
        self.names = names
        self._lines, self._first = lines, first + self.has_header

    def columns(self, which: list[int]) -> Array:
        """(rows, len(which)). Raises CannotImport with the line of what is no number, or of a row too short."""
        if (quick := self._all_numbers(which)) is not None:
            return quick
        parts, line = [], self._first
        rows = self._rows(self._lines[self._first :])
        while chunk := list(islice(rows, CHUNK)):
            full = [r for r in chunk if r]
            if any(len(r) != self.width for r in full):
                k = next(k for k, r in enumerate(chunk) if r and len(r) != self.width)
                raise CannotImport(f"{self.source}:{line + k + 1}: {len(chunk[k])} fields, {self.width} expected")
            parts.append(self._numbers(full, chunk, which, line))
            line += len(chunk)
        out = np.concatenate(parts) if parts else np.empty((0, len(which)))
        if not len(out):
            raise CannotImport(f"{self.source}: no rows in it")
        return out

    def _all_numbers(self, which: list[int]) -> Array | None:
        """`columns` of a table that has a number in every field, in a tenth of the time; None of another."""
        lines = [line for line in self._lines[self._first :] if line.strip()]
        fields = self.width - 1
        if not lines or self.comma or self.separator == " ":
            return None
        if any(line.count(self.separator) != fields for line in lines):
            return None
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            try:
                return np.loadtxt(lines, delimiter=self.separator, usecols=which, ndmin=2, comments=None)
            except (ValueError, UserWarning):
                return None

    def _numbers(self, full: list[list[str]], chunk: list[list[str]], which: list[int], line: int) -> Array:
        out = np.empty((len(full), len(which)))
        for j, k in enumerate(which):
            words = [r[k].strip() or "nan" for r in full]
            if self.names and re.search("saturated|clipped|exposed", self.names[k].lower()):
                words = [{"true": "1", "false": "0"}.get(w.lower(), w) for w in words]
            if self.comma:
                words = [w.replace(",", ".") for w in words]
            try:
                out[:, j] = np.array(words, float)
            except (ValueError, OverflowError):
                at = next(i for i, w in enumerate(words) if not _is_number(w, False))
                row = [i for i, r in enumerate(chunk) if r][at]
                name = self.names[k] if self.names else f"column {k + 1}"
                raise CannotImport(
                    f"{self.source}:{line + row + 1}: {name}: {words[at][:40]!r} where a number is expected"
                ) from None
        return out

    def _rows(self, lines: list[str]) -> Iterator[list[str]]:
        if self.separator == " ":
            yield from (line.split() for line in lines)
            return
        try:
            for row in csv.reader(lines, delimiter=self.separator):
                yield row if any(w.strip() for w in row) else []
        except csv.Error as e:
            raise CannotImport(f"{self.source}: not a table ({e})") from None


class ParquetTable:
    """Columns of a parquet file by name. Raises MissingExtra without pyarrow."""

    has_header = True

    def __init__(self, path: Path):
        from gonio.export.extra import needs

        parquet = needs("pyarrow.parquet", "study")
        self.source = str(path)
        data = read_bytes(path, 4 * MOST_BYTES)
        try:
            file = parquet.ParquetFile(io.BytesIO(data))
            rows, wide = file.metadata.num_rows, len(file.schema_arrow.names)
            if rows * 8 * wide > 4 * MOST_BYTES or rows < 1:
                raise CannotImport(
                    f"{path}: {rows} rows of {wide} columns; 1 to {4 * MOST_BYTES // 8 // wide} rows are read"
                )
            self.names = list(file.schema_arrow.names)
            self._file = file
        except CannotImport:
            raise
        except Exception as e:  # pyarrow raises many kinds for damaged files
            raise CannotImport(f"{path}: not a parquet file ({_one_line(e)})") from None

    def columns(self, which: list[int]) -> Array:
        try:
            table = self._file.read(columns=[self.names[k] for k in which])
            return np.stack([np.asarray(table[self.names[k]].to_numpy(), float) for k in which], 1)
        except Exception as e:
            raise CannotImport(f"{self.source}: a column that is no numbers, or damaged ({_one_line(e)})") from None


Table = TextTable | ParquetTable


def open_table(path: Path) -> Table:
    """By suffix: .parquet, or text. Raises CannotImport, MissingExtra."""
    return ParquetTable(path) if path.suffix.lower() in (".parquet", ".pq") else TextTable(read_lines(path), str(path))


def read_table(table: Table, mapping: Mapping, choices: Choices, format: str) -> Readings:
    """Readings of a table whose columns are known. Raises CannotImport."""
    roles = checked(mapping, table.source)
    at_f, at_sigma = mapping.of("f"), mapping.of("sigma")
    if sorted(mapping.columns[k].channel for k in at_f) == ["X", "Y", "Z"]:
        at_f = sorted(at_f, key=lambda k: mapping.columns[k].channel)
    at_clipped = mapping.of("saturated")
    if len(at_f) > MOST_CHANNELS:
        raise CannotImport(f"{table.source}: {len(at_f)} channels, {MOST_CHANNELS} is the most; use fewer columns")
    which = [mapping.of(r)[0] for r in roles] + at_f + at_sigma + at_clipped
    data = table.columns(which)
    n = len(roles)
    wi, wo, said = _directions(dict(zip(roles, data[:, :n].T)), roles, mapping, choices)
    value, found = data[:, n : n + len(at_f)], data[:, n + len(at_f) : len(which) - len(at_clipped)]
    named = [mapping.columns[k].channel for k in at_f]
    channels = tuple(named) if all(named) else channel_names(len(named))
    sigma = np.full_like(value, np.nan)
    for j, k in enumerate(at_sigma):
        channel = mapping.columns[k].channel
        if channel in named:
            sigma[:, named.index(channel)] = found[:, j]
        elif channel == "":  # of all that have none of their own
            own = {mapping.columns[q].channel for q in at_sigma}
            sigma[:, [c for c, name in enumerate(named) if name not in own]] = found[:, j : j + 1]
        else:
            column = mapping.columns[k].name
            raise CannotImport(
                f"{table.source}: {column} is the sigma of {channel}, which is no channel ({', '.join(named)})"
            )
    value, sigma, units = kept(mapping, at_f, value, sigma, table.source)
    clipped = (np.nan_to_num(data[:, len(which) - len(at_clipped) :]) != 0).any(1)
    if clipped.any():
        said.append(f"{clipped.sum()} of {len(data)} readings are saturated and are left out")
    good, said = ~clipped, said + units
    doubt = None
    if roles == ("theta_i", "theta_o"):
        unused = varying([c.name for c in mapping.columns if c.role == "-"], table)
        doubt = overlooked(data[good, 0], data[good, 1], value[good], sigma[good], unused)
    return Readings(
        wi[good],
        wo[good],
        value[good],
        sigma[good] if len(at_sigma) else None,
        channels,
        mapping.quantity,
        format,
        mapping.to_json(),
        tuple(said),
        doubts=(doubt,) if doubt else (),
    )


def _directions(columns: dict[str, Array], roles, mapping: Mapping, choices: Choices) -> tuple[Array, Array, list[str]]:
    """wi, wo, and what was guessed about them."""
    if roles == VECTORS:
        c = columns
        return (
            *d.vectors(np.stack([c["wi_x"], c["wi_y"], c["wi_z"]], 1), np.stack([c["wo_x"], c["wo_y"], c["wo_z"]], 1)),
            [],
        )
    said = []
    named = {c.role: c.unit for c in mapping.columns}
    if choices.unit is None and len({named[k] for k in roles} - {""}) > 1:
        said.append("angles are taken as their columns say: " + ", ".join(f"{k} {named[k]}" for k in roles if named[k]))
    units = {k: choices.unit or named[k] or mapping.unit for k in roles}
    if open_ := [k for k in roles if units[k] is None]:
        largest = max(np.nanmax(np.abs(columns[k]), initial=0) for k in open_)
        units |= dict.fromkeys(open_, "degrees" if largest > DEGREES_ABOVE else "radians")
        said.append(f"angles are taken as {units[open_[0]]}: the largest is {largest:.4g}")
    columns = {k: np.radians(a) if units[k] == "degrees" else a for k, a in columns.items()}
    with np.errstate(invalid="ignore"):
        if roles == HALF:
            return (*d.half_difference(*(columns[k] for k in HALF)), said)
        if roles == SPHERICAL:
            phi_o = columns["phi_o"]
            if choices.specular_deg is not None:  # of absolute azimuths: 180 is where the mirror direction is anyway
                phi_o = phi_o + np.pi - np.radians(choices.specular_deg)
            return (*d.spherical(columns["theta_i"], columns["phi_i"], columns["theta_o"], phi_o), said)
        phi = next((columns[k] for k in roles if k.startswith("phi")), None)
        specular = choices.specular_deg
        if phi is None:
            phi = np.zeros_like(columns["theta_i"])
            specular = 0.0 if specular is None else specular
            said.append(
                f"no azimuth: all in one plane, theta_o {'above' if specular == 0 else 'below'} 0 on the mirror's side"
            )
        elif specular is None:
            specular = 180.0
            said.append("the mirror direction is taken to be at azimuth 180 degrees (--specular 0 for the other way)")
        return (*d.relative(columns["theta_i"], phi, columns["theta_o"], specular), said)


def _separator(lines: list[str]) -> str:
    """Of the candidates, the first that splits every line into the same number of fields, more than one."""
    for candidate in "\t;,":
        counts = {line.count(candidate) for line in lines}
        if len(counts) == 1 and counts.pop() > 0:
            return candidate
    most = max("\t;,", key=lambda c: lines[0].count(c))
    return most if lines[0].count(most) else " "


def _is_number(word: str, comma: bool) -> bool:
    try:
        float(word.replace(",", ".") if comma else word)
        return True
    except ValueError:
        return False


def _one_line(e: object) -> str:
    return " ".join(str(e).split())[:120]
