"""Where materials come from: a path, the folders of GONIO_MATERIALS, the user's cache, the fits that ship.

Measured tables belong to nobody's package: they are looked up, or fetched from the RGL database into the cache.
"""

import os
from dataclasses import dataclass
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path

from gonio.brdf.base import BrdfFileError

SUFFIXES = ("_rgb.bsdf", ".bsdf", "_spec.bsdf", ".binary")
MADE = {"analytic": "analytic material", "micro": "surface made by gonio, its facets summed"}
BASE_URL = "https://rgl.s3.eu-central-1.amazonaws.com/media/materials"


@dataclass(frozen=True)
class Found:
    """A material: `name`, the file to load, and in words where it came from (to be printed and stored with a run)."""

    name: str
    path: Path
    origin: str


def find(name: str | os.PathLike) -> Found:
    """The material of this name, or at this path. Raises BrdfFileError saying where was looked and what to do."""
    text = os.fspath(name)
    file, colon, _ = text.rpartition(":")
    if os.path.exists(text) or (colon and os.path.exists(file)):
        return Found(Path(text).stem, Path(text), f"file {text}")
    if os.sep in text or Path(text).suffix in (".bsdf", ".binary", ".npz", ".yaml"):
        raise BrdfFileError(f"{text}: no such file")
    for found in available():
        if found.name == text:
            return found
    known = sorted({f.name for f in available()} | set(fetchable()))
    near = get_close_matches(text, known, 3)
    if text in known:
        hint = f"it can be had with `gonio materials fetch {text}`"
    else:
        hint = f"did you mean {', '.join(near)}?" if near else "`gonio materials` lists what there is"
    raise BrdfFileError(f"{text}: no such material in GONIO_MATERIALS, the cache or the fits that ship; {hint}")


def available() -> list[Found]:
    """Every material that can be loaded now, best source first; a name may occur more than once."""
    out = []
    for folder in _folders():
        out += _tables(folder, f"measured table, {folder}")
    out += _tables(cache_folder(), f"measured table, fetched to {cache_folder()}")
    fits = Path(str(files("sim"))) / "materials"
    for path in sorted(fits.glob("*.yaml")):
        kind = path.stem.partition("_")[0]
        origin = MADE.get(kind, "fit that ships with gonio, not the measured table")
        out.append(Found(path.stem, path, origin))
    return out


def fetchable() -> list[str]:
    """Names of the measured tables that `fetch` can get, all CC0."""
    return sorted(key.removesuffix("_rgb.bsdf") for key in registry())


def registry() -> dict[str, str]:
    """File name -> SHA-256 of the tables known to this version."""
    text = (files("gonio.brdf") / "rgl_sha256.txt").read_text()
    return {file: checksum for checksum, file in (line.split() for line in text.splitlines() if line.strip())}


def cache_folder() -> Path:
    """Where fetched tables are kept: GONIO_CACHE, or the user's cache."""
    if given := os.environ.get("GONIO_CACHE"):
        return Path(given)
    from platformdirs import user_cache_path

    return user_cache_path("gonio") / "materials"


def fetch(name: str, folder: Path | None = None, base_url: str | None = None, within: float = 600) -> Found:
    """Get the measured table of `name` into `folder` (the cache unless given), at most `within` seconds.

    A download that breaks off is kept apart and continued by the next call. base_url: GONIO_MATERIALS_URL, or the
    database's own. Raises BrdfFileError: unknown name, no network, too slow, wrong checksum, disk full.
    """
    import pooch

    from gonio.brdf.download import RangeDownloader

    file = f"{name}_rgb.bsdf"
    checksums = registry()
    if file not in checksums:
        near = get_close_matches(name, fetchable(), 3) or fetchable()[:3]
        raise BrdfFileError(f"{name}: not a table that can be fetched; there are {len(checksums)}, {', '.join(near)} …")
    url = base_url or os.environ.get("GONIO_MATERIALS_URL") or BASE_URL
    folder = folder or cache_folder()
    pooch.get_logger().setLevel("ERROR")
    urls = {file: f"{url}/{name}/{file}"}
    shelf = pooch.create(path=folder, base_url="", registry={file: checksums[file]}, urls=urls, retry_if_failed=0)
    try:
        path = shelf.fetch(file, downloader=RangeDownloader(folder / f".{file}.part", within))
    except ValueError:
        raise BrdfFileError(f"{url}/{name}/{file}: wrong checksum, so it was thrown away; try again later") from None
    except OSError as e:
        raise BrdfFileError(f"{url}/{name}/{file}: cannot be fetched ({e}); try again to go on") from None
    return Found(name, Path(path), f"measured table, fetched to {folder}")


def _folders() -> list[Path]:
    return [Path(p) for p in os.environ.get("GONIO_MATERIALS", "").split(os.pathsep) if p]


def _tables(folder: Path, origin: str) -> list[Found]:
    if not folder.is_dir():
        return []
    out = []
    for suffix in SUFFIXES:
        for path in sorted(folder.glob(f"*{suffix}")):
            longer = [s for s in SUFFIXES if s != suffix and s.endswith(suffix)]
            if not path.name.startswith(".") and not any(path.name.endswith(s) for s in longer):
                out.append(Found(path.name.removesuffix(suffix), path, origin))
    return out
