"""Zemax's Tabular BSDF text (also "BSDF Data Interchange", Radiant Imaging 2008), `.bsdf`.

Keywords: Symmetry, SpectralContent (Monochrome, XYZ), ScatterType, and the angles in degrees of SampleRotation,
AngleOfIncidence, ScatterAzimuth, ScatterRadial; then for each incidence `TIS value` and a row an azimuth, a number a
radial angle. Radial and azimuth are counted from the mirror direction, azimuth 0 towards the normal; PlaneSymmetrical
files have azimuths 0 to 180 only, ASymmetrical4D ones several rotations. support.zemax.com, "Zemax Tabular BSDF data
file format" (R. Rykowski).
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gonio.geometry import Array
from gonio.importing import CannotImport, Readings
from gonio.importing.directions import about_mirror, turned
from gonio.importing.text import count, numbers, read_lines

MOST_ANGLES = 100_000
MOST_VALUES = 5_000_000
ANGLES = ("SampleRotation", "AngleOfIncidence", "ScatterAzimuth", "ScatterRadial")
BLOCKS = ("Monochrome", "TristimulusX", "TristimulusY", "TristimulusZ")


def read(path: Path) -> Readings:
    """Raises CannotImport."""
    lines = content(read_lines(path))
    head = Header.of(lines, str(path), ANGLES)
    if head.words.get("ScatterType", "BRDF").upper() != "BRDF":
        raise CannotImport(f"{path}: ScatterType {head.words['ScatterType'][:20]}; only reflection (BRDF) is read")
    rotation, incidence, azimuth, radial = (head.angles.get(k, np.zeros(1)) for k in ANGLES)
    for key in ANGLES[1:]:
        if key not in head.angles:
            raise CannotImport(f"{path}: no {key} in it; is it of another kind (--format)?")
    xyz = head.words.get("SpectralContent", "Monochrome").upper() == "XYZ"
    colours = 3 if xyz else 1
    shape = (colours, len(rotation), len(incidence), len(azimuth), len(radial))
    if np.prod(np.array(shape, float)) > MOST_VALUES:
        raise CannotImport(f"{path}: {'x'.join(map(str, shape))} values announced, {MOST_VALUES} are the most")
    values = _values(lines[head.end :], str(path), shape)
    r, i, a, s = np.meshgrid(*(np.radians(x) for x in (rotation, incidence, azimuth, radial)), indexing="ij")
    wi, wo = about_mirror(i.ravel(), s.ravel(), a.ravel())
    wi, wo = (turned(w, r.ravel()) for w in (wi, wo))
    said = []
    below = wo[:, 2] <= 0
    if below.any():  # the circle about a slanting mirror direction always reaches below: no reading was there
        said.append(f"{below.sum()} entries of the grid are below the horizon and empty by its nature")
    keep = ~below
    value = np.moveaxis(values.reshape(colours, -1), 0, 1)
    mapping = {k: f"{len(head.angles.get(k, [0]))} angles" for k in ANGLES}
    names = ("X", "Y", "Z") if xyz else ("Y",)
    turns = head.words.get("Symmetry", "").lower() == "asymmetrical4d" and len(rotation) > 1
    symmetry = "anisotropic" if turns else None
    return Readings(wi[keep], wo[keep], value[keep], None, names, "f", "zemax", mapping, tuple(said), symmetry)


def _values(lines: list[tuple[int, str]], source: str, shape: tuple[int, ...]) -> Array:
    """The numbers after each TIS, in the order of the file: colours, rotations, incidences, azimuths, radials."""
    each = shape[3] * shape[4]
    blocks: list[list[str]] = []
    begins: list[int] = []
    inside = False
    for number, line in lines:
        word = line.split()[0]
        if word in BLOCKS or word.startswith("Data"):
            inside = False
        elif word == "TIS":
            blocks.append([])
            begins.append(number)
            inside = True
        elif inside:
            blocks[-1].append(line)
        else:
            raise CannotImport(f"{source}:{number}: {line[:40]!r} where TIS, DataBegin or DataEnd is expected")
    wanted = int(np.prod(shape[:3]))
    if len(blocks) != wanted:
        raise CannotImport(f"{source}: {len(blocks)} blocks of data (TIS), the angles announce {wanted}")
    out = np.empty((wanted, each))
    for k, (block, begin) in enumerate(zip(blocks, begins)):
        row = numbers(block, source, begin + 1)
        if len(row) != each:
            raise CannotImport(f"{source}:{begin}: {len(row)} values after TIS, {shape[3]} x {shape[4]} expected")
        out[k] = row
    return out.reshape(shape)


def content(lines: list[str]) -> list[tuple[int, str]]:
    """(line number, line) of lines that say something."""
    return [(k + 1, t) for k, line in enumerate(lines) if (t := line.strip()) and not t.startswith("#")]


@dataclass(frozen=True)
class Header:
    """Keywords with a word, keywords with a list of angles (degrees), and the number of lines that they took."""

    words: dict[str, str]
    angles: dict[str, Array]
    end: int

    @classmethod
    def of(cls, lines: list[tuple[int, str]], source: str, lists: tuple[str, ...]) -> "Header":
        words: dict[str, str] = {}
        angles: dict[str, Array] = {}
        at = 0
        while at < len(lines):
            number, line = lines[at]
            parts = line.split()
            if parts[0] in ("DataBegin", *BLOCKS):
                return cls(words, angles, at)
            at += 1
            if parts[0] not in lists:
                words[parts[0]] = " ".join(parts[1:])
                continue
            n = count(parts[1] if len(parts) > 1 else "", f"{source}:{number}: {parts[0]}", MOST_ANGLES)
            found = parts[2:]
            while len(found) < n and at < len(lines) and not re.match(r"[A-Za-z]{4}", lines[at][1]):
                found += lines[at][1].split()
                at += 1
            values = numbers([" ".join(found)], source, number + 1)
            if len(values) != n or not np.isfinite(values).all() or np.abs(values).max() > 360:
                raise CannotImport(
                    f"{source}:{number}: {parts[0]}: {n} angles within 360 degrees expected, {len(values)} found"
                )
            angles[parts[0]] = values
        raise CannotImport(f"{source}: no DataBegin in it; is it of another kind (--format)?")
