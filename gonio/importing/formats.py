"""Which reader for which file: by --format, else by its first bytes."""

import re
from pathlib import Path

from gonio.importing import CannotImport, Readings
from gonio.importing.delimited import Choices, open_table, read_table
from gonio.importing.merl import ENTRIES
from gonio.importing.roles import Mapping, by_hand, guess
from gonio.importing.text import MOST_BYTES, read_bytes

FORMATS = {
    "csv": "CSV, TSV or other columns with a header",
    "parquet": "columns of a parquet file",
    "pab": "pab Mountain text, files or a folder of them",
    "merl": "MERL binary table",
    "astm": "ASTM E1392 text",
    "json": "BRDF-JSON",
    "zemax": "Zemax Tabular BSDF text",
    "lighttools": "LightTools BSDF text",
    "speos": "SPEOS anisotropic BSDF text",
    "cornell": "rows of numbers without a header (Cornell)",
}
TABLES = ("csv", "parquet")
PEEK = 65536


def sniff(path: Path) -> str:
    """A key of FORMATS. Raises CannotImport for what is none of them."""
    if path.is_dir():
        return "pab"
    try:
        with path.open("rb") as stream:
            begin = stream.read(PEEK)
    except OSError:
        read_bytes(path, MOST_BYTES)  # says why
        raise
    if begin[:12] == b"tensor_file\0":
        raise CannotImport(
            f"{path}: an RGL table, which is a BRDF and no readings; `truth: {path}` measures it in simulation"
        )
    if begin[:4] == b"PAR1":
        return "parquet"
    if path.suffix.lower() == ".binary" or begin[:12] == b"Z\0\0\0Z\0\0\0\xb4\0\0\0":
        return "merl"
    if begin[:8] == b"\x89HDF\r\n\x1a\n":
        raise CannotImport(f"{path}: HDF5; export its readings to CSV or parquet")
    text = begin.decode("utf-8-sig", "replace")
    if text.lstrip().startswith("{"):
        return "json"
    if "Anisotropic BSDF" in text[:200]:
        return "speos"
    if re.search(r"^\s*ScatterRadial\b", text, re.M):
        return "zemax" if re.search(r"^\s*AngleOfIncidence\b", text, re.M) else "lighttools"
    if re.search(r"^#\s*(intheta|incident_angle|format:)", text, re.M):
        return "pab"
    if re.search(r"^\s*VARS\b", text, re.M):
        return "astm"
    row = next((line for line in text.split("\n") if line.strip() and line.lstrip()[0] not in "#%"), "")
    words = re.split(r"[\s,;]+", row.strip())
    return "cornell" if len(words) > 4 and all(re.fullmatch(r"[-+.\deE]+", w) for w in words) else "csv"


def mapping_of(path: Path, given: list[str]) -> Mapping:
    """How the columns of a table are taken: guessed, then as `given` says. Raises CannotImport."""
    table = open_table(path)
    # a parquet table always has a header, and thus no need of a width
    names = table.names if table.has_header else [f"column {k + 1}" for k in range(table.width)]  # type: ignore[union-attr]
    return by_hand(guess(names), given)


def read(paths: list[Path], format: str, mapping: Mapping | None, choices: Choices, entries: int = ENTRIES) -> Readings:
    """Raises CannotImport, MissingExtra."""
    from gonio.importing import astm, brdf_json, cornell, lighttools, merl, pab, speos, zemax

    if format == "pab":
        return pab.read([f for p in paths for f in (pab.files_of(p) if p.is_dir() else [p])])
    if len(paths) > 1:
        raise CannotImport(f"{paths[1]}: one file at a time, but for pab")
    path = paths[0]
    if format in TABLES:
        assert mapping is not None
        return read_table(open_table(path), mapping, choices, format)
    if format in ("astm", "cornell"):
        return {"astm": astm, "cornell": cornell}[format].read(path, choices)
    if format == "merl":
        return merl.read(path, entries)
    return {"json": brdf_json, "zemax": zemax, "lighttools": lighttools, "speos": speos}[format].read(path)
