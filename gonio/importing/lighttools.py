"""LightTools' BSDF text: the keywords of Zemax's, but directions counted from the normal, and blocks that say where.

After DataBegin each block has AOI, POI (degrees), Side, Wavelength, ScatterType, TristimulusValue, `TIS value`, then a
row an azimuth, a number a radial angle. The light of AOI is at azimuth 90 + POI. Blocks of the back side and of
transmission are left out. As libbsdf reads it (LightToolsBsdfReader.cpp, R. Kimura).
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gonio.geometry import Array
from gonio.importing import CannotImport, Readings
from gonio.importing.directions import spherical
from gonio.importing.text import number, numbers, read_lines
from gonio.importing.zemax import MOST_VALUES, Header, content

LIGHT_AT_DEG = 90.0
TRISTIMULUS = {"TrisX": 0, "TrisY": 1, "TrisZ": 2}
WORDS = ("AOI", "POI", "Side", "Wavelength", "ScatterType", "TristimulusValue", "TIS")


@dataclass(frozen=True)
class _Block:
    said: dict[str, str]
    line: int
    values: Array

    @property
    def wanted(self) -> bool:
        return self.said.get("Side", "Front") == "Front" and self.said.get("ScatterType", "BRDF") == "BRDF"


def read(path: Path) -> Readings:
    """Raises CannotImport."""
    source = str(path)
    lines = content(read_lines(path))
    head = Header.of(lines, source, ("ScatterAzimuth", "ScatterRadial"))
    if "ScatterAzimuth" not in head.angles or "ScatterRadial" not in head.angles:
        raise CannotImport(f"{path}: no ScatterAzimuth and ScatterRadial in it; is it of another kind (--format)?")
    azimuth, radial = head.angles["ScatterAzimuth"], head.angles["ScatterRadial"]
    each = len(azimuth) * len(radial)
    if each > MOST_VALUES:
        raise CannotImport(
            f"{path}: {len(azimuth)} x {len(radial)} values a block announced, {MOST_VALUES} are the most"
        )
    blocks = _blocks(lines[head.end :], source, each)
    kept = [b for b in blocks if b.wanted]
    if not kept:
        raise CannotImport(f"{path}: no block of the front side's reflection in it")
    xyz = head.words.get("SpectralContent", "Monochrome") == "XYZ"
    places: dict[tuple[float, float], dict[int, Array]] = {}
    for b in kept:
        where = f"{source}:{b.line}: AOI"
        at = number(b.said.get("AOI", "none"), where), number(b.said.get("POI", "0"), where)
        colour = TRISTIMULUS.get(b.said.get("TristimulusValue", "TrisX"), -1) if xyz else 0
        if colour < 0 or colour in places.setdefault(at, {}):
            raise CannotImport(f"{source}:{b.line}: a second block of this incidence and colour, or an unknown colour")
        places[at][colour] = b.values
    if any(len(found) != (3 if xyz else 1) for found in places.values()):
        raise CannotImport(f"{path}: an incidence with fewer than three tristimulus blocks")
    a, r = (x.ravel() for x in np.meshgrid(np.radians(azimuth), np.radians(radial), indexing="ij"))
    wi, wo, value = [], [], []
    for (aoi, poi), found in places.items():
        theta, phi = np.full(each, np.radians(aoi)), np.full(each, np.radians(LIGHT_AT_DEG + poi))
        one = spherical(theta, phi, r, a)
        wi.append(one[0])
        wo.append(one[1])
        value.append(np.stack([found[c] for c in sorted(found)], 1))
    left = len(blocks) - len(kept)
    said = [f"{left} blocks of the back side or of transmission are left out"] if left else []
    mapping = {
        "AOI": f"{len(places)} incidences",
        "ScatterAzimuth": str(len(azimuth)),
        "ScatterRadial": str(len(radial)),
    }
    names = ("X", "Y", "Z") if xyz else ("Y",)
    both = np.concatenate(wi), np.concatenate(wo)
    return Readings(*both, np.concatenate(value), None, names, "f", "lighttools", mapping, tuple(said))


def _blocks(lines: list[tuple[int, str]], source: str, each: int) -> list[_Block]:
    blocks: list[_Block] = []
    said: dict[str, str] = {}
    at, total = 0, 0
    while at < len(lines):
        line, text = lines[at]
        word, _, rest = text.replace("\t", " ").partition(" ")
        at += 1
        if word in ("DataBegin", "DataEnd"):
            continue
        if word not in WORDS:
            raise CannotImport(f"{source}:{line}: {text[:40]!r} where one of {', '.join(WORDS)} is expected")
        said[word] = rest.strip()
        if word != "TIS":
            continue
        begin, body, found = at, [], 0
        while at < len(lines) and found < each:
            body.append(lines[at][1])
            found += len(lines[at][1].split())
            at += 1
        values = numbers(body, source, lines[begin][0] if begin < len(lines) else line)
        total += len(values)
        if len(values) != each or total > MOST_VALUES:
            raise CannotImport(f"{source}:{line}: {len(values)} values after TIS, {each} expected")
        blocks.append(_Block(said, line, values))
        said = {}
    return blocks
