"""Which column is what: guessed from a header, corrected by hand, shown as a table.

A role is a quantity of DIRECTIONS, `f`, `sigma`, `saturated` (not 0: the row is left out) or `-` (not used);
values and their sigmas have a channel. A header
as gonio's own exports write it (`theta_i_deg`, ..., `f_R`) is no guess.
"""

import re
from dataclasses import dataclass, replace

from gonio.importing import QUANTITIES, CannotImport
from gonio.importing.columns.names import split

SPHERICAL = ("theta_i", "phi_i", "theta_o", "phi_o")
RELATIVE = ("theta_i", "theta_o", "phi")
HALF = ("theta_h", "phi_h", "theta_d", "phi_d")
VECTORS = ("wi_x", "wi_y", "wi_z", "wo_x", "wo_y", "wo_z")
DIRECTIONS = tuple(dict.fromkeys((*SPHERICAL, *RELATIVE, *HALF, *VECTORS)))
UNITS = ("degrees", "radians")

_IN = "i|in|inc|incident|incidence|incoming|illumination|illum|light|source|sun|solar|l"
_OUT = (
    "o|out|outgoing|r|refl|reflected|reflection|s|scatter|scattered|scattering|v|view|viewing|obs|observation"
    "|det|detector|e"
)
_POLAR = "theta|th|θ|zenith|polar"
_AZIMUTH = "phi|φ|ϕ|azimuth|az|azi"
_PATTERNS: list[tuple[str, str]] = [
    ("theta_i", rf"(?:{_POLAR})(?:{_IN})|(?:{_IN})(?:angle|{_POLAR})|aoi|angleofincidence|incidence|sza"),
    ("theta_o", rf"(?:{_POLAR})(?:{_OUT})|(?:{_OUT})(?:angle|{_POLAR})|vza"),
    ("phi_i", rf"(?:{_AZIMUTH})(?:{_IN})|(?:{_IN})(?:{_AZIMUTH})|saa"),
    ("phi_o", rf"(?:{_AZIMUTH})(?:{_OUT})|(?:{_OUT})(?:{_AZIMUTH})|vaa"),
    ("phi", rf"(?:{_AZIMUTH})|raa|(?:rel|relative|d|delta|Δ|δ)(?:{_AZIMUTH})|(?:{_AZIMUTH})rel(?:ative)?"),
    ("theta_h", rf"(?:{_POLAR})(?:h|half)|half(?:{_POLAR})"),
    ("phi_h", rf"(?:{_AZIMUTH})(?:h|half)|half(?:{_AZIMUTH})"),
    ("theta_d", rf"(?:{_POLAR})(?:d|diff|difference)|(?:diff|difference)(?:{_POLAR})"),
    ("phi_d", rf"(?:{_AZIMUTH})(?:d|diff|difference)|(?:diff|difference)(?:{_AZIMUTH})"),
    *((f"{w}_{a}", rf"(?:{w}|{names}){a}") for w, names in (("wi", "light|in|incident"), ("wo", "view|out|detector"))
      for a in "xyz"),
]  # fmt: skip
_VALUES: list[tuple[str, str]] = [
    ("f_cos", "f_?cos|brdf_?cos|bsdf_?cos|ccbrdf|ccbsdf|dsf"),
    ("factor", "reflectance_?factor|radiance_?factor|brf|rf|beta|reflectance|refl"),
    ("counts", "counts|signal|intensity|voltage|adc|current"),
    ("f", "f|fr|brdf|bsdf|bdrf|value|values"),
]
_SIGMA = "sigma|std|stdev|sd|u|unc|uncertainty|error|err|ubrdf|u_?f|u_?brdf|sigma_?f"
_SATURATED = r"(?:is_?)?(?:saturated|clipped|overexposed)(?:_?flag)?"
_WAVELENGTH = re.compile(r"(\d{3,4}(?:\.\d+)?)\s*(?:nm)?")
_EXACT = re.compile(r"(theta_i|phi_i|theta_o|phi_o)_deg")


@dataclass(frozen=True)
class Column:
    """One column: its name in the file, its role, its channel (values and sigmas), the unit its name gives (angles),
    and how its role is known: the name itself, a guess, or by hand."""

    name: str
    role: str = "-"
    channel: str = ""
    unit: str = ""
    how: str = "not used"


@dataclass(frozen=True)
class Mapping:
    """The columns of a table in their order; quantity of the values, None where no name says it."""

    columns: tuple[Column, ...]
    quantity: str | None

    def of(self, role: str) -> list[int]:
        """Numbers of the columns with a role."""
        return [k for k, c in enumerate(self.columns) if c.role == role]

    @property
    def guessed(self) -> bool:
        return any(c.how == "guess" for c in self.columns)

    @property
    def unit(self) -> str | None:
        """Of the angles whose name says none, where the others' names agree on one."""
        named = {c.unit for c in self.columns if c.role in DIRECTIONS and c.unit}
        return named.pop() if len(named) == 1 else None

    def lines(self) -> list[str]:
        """The table that is shown."""
        used = [c for c in self.columns if c.role != "-"]
        rows = [(c.name, c.role + (f" of {c.channel}" if c.channel else ""), c.unit, c.how) for c in used]
        width = [max(len(r[k]) for r in [*rows, ("column", "taken as", "unit", "how")]) for k in range(4)]
        head = [("column", "taken as", "unit", "how"), *rows]
        out = ["  ".join(cell.ljust(w) for cell, w in zip(row, width)).rstrip() for row in head]
        unused = [c.name for c in self.columns if c.role == "-"]
        return out + ([f"not used: {', '.join(unused)[:200]}"] if unused else [])

    def to_json(self) -> dict[str, str]:
        return {c.name: c.role + (f":{c.channel}" if c.channel else "") for c in self.columns if c.role != "-"}


def guess(names: list[str]) -> Mapping:
    """From a header alone."""
    if all(any(_bare(n) == f"{k}_deg" for n in names) for k in SPHERICAL) and any(n.startswith("f_") for n in names):
        return _own(names)
    columns, quantity = [], None
    for name in names:
        bare, unit = split(name)
        compact = re.sub(r"[\s_\-.]", "", bare)
        column = Column(name)
        for role, pattern in _PATTERNS:
            if re.fullmatch(pattern, compact):
                column = Column(name, role, "", unit if not role.startswith("w") else "", "guess")
                break
        columns.append(column)
    columns = _plain_azimuth(_difference(columns))
    for k, name in enumerate(names):
        if columns[k].role != "-":
            continue
        found = _value(name)
        if found is not None:
            column, kind = found
            columns[k] = column
            quantity = quantity or kind
    return Mapping(tuple(_sigmas(_tristimulus(_colours(_one_kind(columns), names)))), quantity)


def by_hand(mapping: Mapping, given: list[str]) -> Mapping:
    """`given` are texts NAME=ROLE or NAME=ROLE:CHANNEL. Raises CannotImport for names or roles that do not exist."""
    columns = list(mapping.columns)
    quantity = mapping.quantity
    for text in given:
        name, sign, role = text.rpartition("=")
        role, _, channel = role.partition(":")
        at = [k for k, c in enumerate(columns) if c.name == name.strip()]
        if not sign or not at:
            have = ", ".join(c.name for c in columns)
            raise CannotImport(f"--column {text}: no such column; NAME=ROLE wanted, the names are {have[:300]}")
        role = role.strip()
        if role in QUANTITIES:
            quantity, role = role, "f"
        if role not in (*DIRECTIONS, "f", "sigma", "saturated", "-"):
            known = ", ".join((*DIRECTIONS, *QUANTITIES, "sigma", "saturated", "-"))
            raise CannotImport(f"--column {text}: no role {role!r}; they are {known}")
        old = columns[at[0]]
        columns[at[0]] = replace(
            old, role=role, channel=channel or (old.channel if role in ("f", "sigma") else ""), how="by hand"
        )
    return Mapping(tuple(_tristimulus(columns)), quantity)


def checked(mapping: Mapping, source: str) -> tuple[str, ...]:
    """The roles of the directions, one of SPHERICAL, RELATIVE, HALF, VECTORS or the in-plane (theta_i, theta_o).

    Raises CannotImport where they are not complete, or twice, or nothing is measured.
    """
    have = [c.role for c in mapping.columns]
    for role in DIRECTIONS:
        if have.count(role) > 1:
            twice = [c.name for c in mapping.columns if c.role == role]
            raise CannotImport(f"{source}: {' and '.join(twice)} are both taken as {role}; say so by --column")
    if "f" not in have:
        raise CannotImport(f"{source}: no column is taken as a value; name one by --column NAME=f")
    channels = [c.channel for c in mapping.columns if c.role == "f"]
    if len(set(channels)) < len(channels):
        raise CannotImport(f"{source}: two values of one channel; name them apart by --column NAME=f:CHANNEL")
    for roles in (SPHERICAL, HALF, VECTORS, RELATIVE):
        if all(r in have for r in roles):
            return roles
    if "theta_i" in have and "theta_o" in have:
        if ("phi_i" in have) != ("phi_o" in have):
            return ("theta_i", "theta_o", "phi_i" if "phi_i" in have else "phi_o")
        return ("theta_i", "theta_o")
    missing = min((tuple(r for r in roles if r not in have) for roles in (SPHERICAL, HALF, VECTORS, RELATIVE)), key=len)
    raise CannotImport(f"{source}: no column is taken as {', '.join(missing)}; say by --column NAME=ROLE")


def _bare(name: str) -> str:
    return name.strip().lower()


def _own(names: list[str]) -> Mapping:
    columns = []
    for name in names:
        bare = _bare(name)
        if m := _EXACT.fullmatch(bare):
            columns.append(Column(name, m[1], "", "degrees", "name"))
        elif bare.startswith(("f_", "sigma_")):
            role, _, channel = name.strip().partition("_")
            columns.append(Column(name, role.lower(), channel, "", "name"))
        else:
            columns.append(Column(name, "saturated", "", "", "name") if bare == "saturated" else Column(name))
    return Mapping(tuple(_numbered(columns)), "f")


def _numbered(columns: list[Column]) -> list[Column]:
    """Channels 0, 1, 2 as gonio numbers them are R, G, B; others get a letter."""
    numbers = [c.channel for c in columns if c.role == "f"]
    if numbers != [str(k) for k in range(len(numbers))]:
        return columns
    new = ("R", "G", "B") if len(numbers) == 3 else tuple(f"c{k}" for k in numbers)
    known = dict(zip(numbers, new))
    return [replace(c, channel=known.get(c.channel, c.channel)) if c.role in ("f", "sigma") else c for c in columns]


def _difference(columns: list[Column]) -> list[Column]:
    """theta_d and phi_d are the detector's where no half vector is there."""
    have = {c.role for c in columns}
    if "theta_h" in have or "theta_d" not in have or "theta_o" in have:
        return columns
    swap = {"theta_d": "theta_o", "phi_d": "phi_o"}
    return [replace(c, role=swap.get(c.role, c.role)) for c in columns]


def _plain_azimuth(columns: list[Column]) -> list[Column]:
    """A lone `phi` is the azimuth between the planes; beside one of phi_i, phi_o it is the other."""
    have = {c.role for c in columns}
    if "phi" not in have or ("phi_i" in have) == ("phi_o" in have):
        return columns
    other = "phi_o" if "phi_i" in have else "phi_i"
    return [replace(c, role=other) if c.role == "phi" else c for c in columns]


def _value(name: str) -> tuple[Column, str] | None:
    bare, _ = split(name)
    if re.fullmatch(_SATURATED, bare):
        return Column(name, "saturated", "", "", "guess"), ""
    if m := re.fullmatch(rf"(?:{_SIGMA})(?:[_\s\-.:](.+))?", bare):
        return Column(name, "sigma", _channel(m[1], name), "", "guess"), ""
    for kind, pattern in _VALUES:
        if m := re.fullmatch(rf"(?:{pattern})(?:[_\s\-.:](.+))?", bare):
            return Column(name, "f", _channel(m[1], name), "", "guess"), kind
    if _WAVELENGTH.fullmatch(bare):
        return Column(name, "f", bare, "", "guess"), ""
    return None


def _channel(found: str | None, name: str) -> str:
    """As the file writes it, in its own case."""
    if not found:
        return ""
    at = name.lower().rfind(found)
    return name[at : at + len(found)].strip() if at >= 0 else found


def _colours(columns: list[Column], names: list[str]) -> list[Column]:
    """Columns R, G, B or X, Y, Z by themselves are values, where all three are there and no other is."""
    if any(c.role == "f" for c in columns):
        return columns
    bare = [_bare(n) for n in names]
    for colours in ("rgb", "xyz"):
        if all(bare.count(letter) == 1 for letter in colours):
            at = {bare.index(letter): letter.upper() for letter in colours}
            return [replace(c, role="f", channel=at[k], how="guess") if k in at else c for k, c in enumerate(columns)]
    return columns


def _tristimulus(columns: list[Column]) -> list[Column]:
    """Channels x, y, z in any case are X, Y, Z where they are all three and no other is."""
    if sorted(c.channel.lower() for c in columns if c.role == "f") != ["x", "y", "z"]:
        return columns
    return [replace(c, channel=c.channel.upper()) if c.role in ("f", "sigma") else c for c in columns]


def _one_kind(columns: list[Column]) -> list[Column]:
    """Where several kinds of values stand side by side (f, and what a BRDF says of itself), the first kind counts."""
    kinds = [_kind(c.name) if c.role == "f" else "" for c in columns]
    first = next((kind for kind in kinds if kind), "")
    return [c if kind in ("", first) else Column(c.name) for c, kind in zip(columns, kinds)]


def _kind(name: str) -> str:
    bare, _ = split(name)
    return "nm" if _WAVELENGTH.fullmatch(bare) else re.split(r"[_\s\-.:]", bare)[0]


def _sigmas(columns: list[Column]) -> list[Column]:
    """Those of channels that are there, each once."""
    channels, seen = {c.channel for c in columns if c.role == "f"}, set()
    out = []
    for c in columns:
        keep = c.role != "sigma" or (c.channel in channels and c.channel not in seen)
        seen |= {c.channel} if c.role == "sigma" else set()
        out.append(c if keep else Column(c.name))
    return out
