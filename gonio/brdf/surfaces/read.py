"""Micro-surfaces by name: `surface: brushed` or `woven` in a YAML file."""

from functools import lru_cache
from typing import Any

from gonio.brdf.base import BrdfFileError
from gonio.brdf.surfaces.micro import MicroSurface
from gonio.brdf.surfaces.shapes import brushed, woven


def read_surface(path: str, d: dict[str, Any]) -> MicroSurface:
    """Of the keys of a file: name, surface, and seed of a brushed one. Raises BrdfFileError."""
    wrong = sorted(set(d) - {"name", "surface", "seed"})
    if wrong:
        raise BrdfFileError(f"{path}: {wrong[0]}: no such key; a surface has name, surface and seed")
    name, seed = d["surface"], d.get("seed", 1)
    if name not in ("brushed", "woven"):
        raise BrdfFileError(f"{path}: surface: {name!r} is not one of brushed, woven")
    if type(seed) is not int or seed < 0:
        raise BrdfFileError(f"{path}: seed: {seed!r} is not a whole number from 0")
    return _made(name, seed)


@lru_cache(maxsize=4)
def _made(name: str, seed: int) -> MicroSurface:
    return MicroSurface(brushed(seed) if name == "brushed" else woven())
