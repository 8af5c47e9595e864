"""The text of pab goniophotometers (Mountain): one file an incidence, `theta phi value ...` a line, degrees.

Header lines begin with #: `intheta`, `inphi`, or both as `incident_angle`; `format: theta phi DSF` (f cos theta_o) or
BSDF, BRDF (f); `colorimetry: CIE-XYZ` or CIE-Y. As Radiance reads them: src/cv/pabopto2bsdf.c and its manual page,
G. Ward; pab-opto.de, "Mountain display". A theta above 90 is transmission: below the horizon here.
"""

import re
from pathlib import Path

import numpy as np

from gonio.importing import CannotImport, Readings
from gonio.importing.directions import spherical
from gonio.importing.text import MOST_BYTES, channel_names, number, numbers, read_lines

SUFFIXES = (".txt", ".dat", ".out", ".asc")
FORMATS = {"dsf": "f_cos", "bsdf": "f", "brdf": "f", "btdf": "f"}
MOST_FILES = 2000


def files_of(path: Path) -> list[Path]:
    """The measurements of a folder, in the order of their names."""
    found = sorted(p for p in path.iterdir() if p.suffix.lower() in SUFFIXES and not p.name.startswith("."))
    if not 1 <= len(found) <= MOST_FILES:
        raise CannotImport(f"{path}: {len(found)} files {' '.join(SUFFIXES)} in it; 1 to {MOST_FILES} expected")
    return found


def read(paths: list[Path]) -> Readings:
    """Raises CannotImport."""
    if (size := sum(p.stat().st_size for p in paths if p.is_file())) > MOST_BYTES:
        raise CannotImport(f"{paths[0]}: {size} bytes in {len(paths)} files, {MOST_BYTES} are the most; import fewer")
    parts = [_one(path) for path in paths]
    for key, what in ((2, "columns of values"), (3, "quantity"), (4, "colorimetry")):
        kinds = {p[1][key] for p in parts}
        if len(kinds) > 1:
            odd = next(path for path, p in zip(paths, parts) if p[1][key] != parts[0][1][key])
            raise CannotImport(f"{odd}: another {what} than in {paths[0]}; import them apart")
    theta_i, phi_i = (np.concatenate([np.full(len(t), h[k]) for t, h in parts]) for k in (0, 1))
    table = np.concatenate([t for t, _ in parts])
    wi, wo = spherical(np.radians(theta_i), np.radians(phi_i), *np.radians(table[:, :2]).T)
    _, _, channels, quantity, colours = parts[0][1]
    names = ("X", "Y", "Z") if colours == "cie-xyz" and channels == 3 else channel_names(channels)
    mapping = {"theta phi": "theta_o phi_o", "values": colours or "unnamed", "files": str(len(paths))}
    return Readings(wi, wo, table[:, 2:], None, names, quantity, "pab", mapping)


def _one(path: Path) -> tuple[np.ndarray, tuple[float, float, int, str | None, str]]:
    """(rows, 2 + C), and theta_i, phi_i, C, quantity, colorimetry of a file."""
    lines = read_lines(path)
    head: dict[str, tuple[int, list[str]]] = {}
    for k, line in enumerate(lines):
        if line.startswith("#") and (words := re.split(r"[\s:=]+", line[1:].strip())):
            head.setdefault(words[0].lower(), (k + 1, words[1:]))
    theta_i, phi_i = _incidence(path, head)
    rows = [k for k, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")]
    if not rows:
        raise CannotImport(f"{path}: no measurements in it")
    width = len(lines[rows[0]].split())
    body = [line if not line.lstrip().startswith("#") else "" for line in lines[rows[0] :]]
    flat = numbers(body, str(path), rows[0] + 1)
    if width < 3 or len(flat) % width or len(flat) != width * len(rows):
        wrong = next((k for k in rows if len(lines[k].split()) != width or width < 3), rows[0])
        raise CannotImport(f"{path}:{wrong + 1}: {len(lines[wrong].split())} numbers; theta, phi and values expected")
    words = head.get("format", (0, []))[1]
    quantity = FORMATS.get(words[-1].lower()) if words else None
    colours = next((w.lower() for w in head.get("colorimetry", (0, []))[1] if w), "")
    return flat.reshape(-1, width), (theta_i, phi_i, width - 2, quantity, colours)


def _incidence(path: Path, head: dict[str, tuple[int, list[str]]]) -> tuple[float, float]:
    if "incident_angle" in head:
        line, words = head["incident_angle"]
        words = [w for w in re.split(r"[\s,]+", " ".join(words)) if w]
        if len(words) >= 2:
            return number(words[0], f"{path}:{line}"), number(words[1], f"{path}:{line}")
    if "intheta" not in head or not head["intheta"][1]:
        raise CannotImport(f"{path}: no #intheta (or #incident_angle) line: where the light was is not known")
    line, words = head["intheta"]
    theta = number(words[0], f"{path}:{line}")
    line, words = head.get("inphi", (0, ["0"]))
    return theta, number(words[0] if words else "", f"{path}:{line}")
