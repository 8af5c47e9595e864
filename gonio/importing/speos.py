"""SPEOS' `.anisotropicbsdf` in text: for each angle of anisotropy and each incidence a table over theta and phi.

Lines: title, 0 (text), comment, length of a description and the description, anisotropy vector, flags of reflection and
transmission, 1 (BSDF) or 0 (intensity, f cos theta_o), number of anisotropy angles and the angles, for each the number
of incidences and the incidences, the incidence (theta, phi) of the spectrum, its title, its length and lines
`nm percent`; then the tables: `thetas phis`, the phis, and a line a theta. All angles are degrees; the mirror direction
is at phi 0. Values are in proportion only: they are scaled so that at the spectrum's incidence the reflectance is the
spectrum's.
ansyshelp.ansys.com, "Structure of Anisotropic BSDF Files"; Ansys' published converters write it so.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gonio.geometry import Array
from gonio.importing import CannotImport, Readings
from gonio.importing.directions import spherical, turned
from gonio.importing.text import MOST_CHANNELS, count, number, numbers, read_lines

MOST = 100_000
MOST_VALUES = 5_000_000


class _Lines:
    """The file's lines, taken one after the other; a complaint names the one at hand."""

    def __init__(self, lines: list[str], source: str):
        self._lines, self.source, self.at = lines, source, 0

    def take(self, what: str) -> str:
        if self.at >= len(self._lines):
            raise CannotImport(f"{self.source}:{self.at}: ends where {what} is expected")
        self.at += 1
        return self._lines[self.at - 1].strip()

    def filled(self, what: str) -> str:
        while not (line := self.take(what)):
            pass
        return line

    def numbers(self, n: int, what: str) -> Array:
        found = numbers([self.filled(what)], self.source, self.at)
        if len(found) != n:
            raise CannotImport(f"{self.where}: {len(found)} numbers, {n} expected ({what})")
        return found

    @property
    def where(self) -> str:
        return f"{self.source}:{self.at}"


@dataclass(frozen=True)
class _Table:
    anisotropy: float
    incidence: float
    theta: Array
    phi: Array
    value: Array  # (theta, phi), in proportion to f

    @property
    def reflectance(self) -> float:
        """The integral of value cos(theta) over the hemisphere, trapezoids in both angles (degrees in)."""
        t = np.radians(self.theta)
        inner = np.trapezoid(self.value, np.radians(self.phi), axis=1)
        return float(np.trapezoid(inner * np.cos(t) * np.sin(t), t))


def read(path: Path) -> Readings:
    """Raises CannotImport."""
    lines = _Lines(read_lines(path), str(path))
    title = lines.take("a title")
    if "Anisotropic BSDF" not in title:
        raise CannotImport(f"{lines.where}: not the title of an anisotropic BSDF; is it of another kind (--format)?")
    if lines.filled("0 for text") != "0":
        raise CannotImport(f"{lines.where}: binary; save it as text in the SPEOS surface editor")
    lines.take("a comment")
    length = number(lines.filled("the length of the description"), lines.where)
    while length > 0 and length < MOST:
        length -= len(lines.take("the description")) + 1
    lines.numbers(3, "the anisotropy vector")
    reflects, _ = lines.numbers(2, "flags of reflection and transmission")
    if not reflects:
        raise CannotImport(f"{lines.where}: transmission only; only reflection is read")
    is_f = lines.filled("1 for BSDF values") == "1"
    turns = _angles(lines, "anisotropy angles")
    incidences = [_angles(lines, "incidences") for _ in turns]
    measured_at = float(lines.numbers(2, "the spectrum's incidence")[0])
    names, percent = _spectrum(lines)
    tables = [_table(lines, t, i, is_f) for t, many in zip(turns, incidences) for i in many]
    return _readings(tables, measured_at, names, percent / 100, str(path))


def _angles(lines: _Lines, what: str) -> Array:
    n = count(lines.filled(f"the number of {what}"), f"{lines.where}: {what}", MOST)
    return lines.numbers(n, what)


def _spectrum(lines: _Lines) -> tuple[tuple[str, ...], Array]:
    """Names of the channels and their reflectances in percent; one channel where all are alike."""
    line = lines.take("the spectrum's title")
    try:
        float(line)
    except ValueError:
        line = lines.filled("the number of wavelengths")
    line = line or lines.filled("the number of wavelengths")
    n = count(line, f"{lines.where}: wavelengths", MOST_CHANNELS)
    rows = np.array([lines.numbers(2, "a wavelength and a reflectance") for _ in range(n)])
    if np.ptp(rows[:, 1]) == 0:
        return ("Y",), rows[:1, 1]
    return tuple(f"{w:.6g}nm" for w in rows[:, 0]), rows[:, 1]


def _table(lines: _Lines, turn: float, incidence: float, is_f: bool) -> _Table:
    words = lines.filled("the size of a table").split()
    thetas, phis = (count(w, lines.where, MOST) for w in (words if len(words) == 2 else ("0", "0")))
    if thetas * phis > MOST_VALUES:
        raise CannotImport(f"{lines.where}: a table of {thetas} x {phis}, {MOST_VALUES} values are the most")
    phi = lines.numbers(phis, "azimuths")
    rows = np.array([lines.numbers(1 + phis, "theta and its values") for _ in range(thetas)])
    value = rows[:, 1:] if is_f else rows[:, 1:] / np.maximum(np.cos(np.radians(rows[:, :1])), 1e-3)
    return _Table(float(turn), float(incidence), rows[:, 0], phi, value)


def _readings(
    tables: list[_Table], measured_at: float, names: tuple[str, ...], reflectance: Array, source: str
) -> Readings:
    nearest = min(tables, key=lambda t: abs(t.incidence - measured_at))
    total = nearest.reflectance
    if not (np.isfinite(total) and total > 0 and np.isfinite(reflectance).all()):
        raise CannotImport(
            f"{source}: the table at {nearest.incidence:g} degrees reflects nothing: the values cannot be scaled"
        )
    wi, wo, value = [], [], []
    for t in tables:
        theta, phi = (a.ravel() for a in np.meshgrid(np.radians(t.theta), np.radians(t.phi), indexing="ij"))
        light = np.full(len(theta), np.radians(t.incidence))
        a, b = spherical(light, np.full(len(theta), np.pi), theta, phi)  # the mirror direction is at 0
        wi.append(turned(a, np.radians(t.anisotropy)))
        wo.append(turned(b, np.radians(t.anisotropy)))
        value.append(t.value.reshape(-1, 1) * reflectance / total)
    said = [f"values scaled to the reflectance that the file gives at {nearest.incidence:g} degrees"]
    mapping = {"tables": str(len(tables)), "anisotropy angles": str(len({t.anisotropy for t in tables}))}
    both = np.concatenate(wi), np.concatenate(wo)
    return Readings(*both, np.concatenate(value), None, names, "f", "speos", mapping, tuple(said))
