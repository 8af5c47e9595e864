"""Configs by path or, for those that ship, by bare name."""

import os
from pathlib import Path

from gonio.config.loader import ConfigError

SHIPPED = Path(__file__).resolve().parents[1] / "configs"


def find_config(name: str | os.PathLike[str], kind: str) -> Path:
    """The YAML file `name`, or configs/<kind>/<name>.yaml below the working folder or the project."""
    path = Path(name)
    if path.is_file() or path.suffix in (".yaml", ".yml") or path.name != str(name):
        return path  # what is wrong with it, if anything, is said by whoever reads it
    for folder in (Path("configs"), SHIPPED):
        candidate = folder / kind / f"{name}.yaml"
        if candidate.is_file():
            return candidate
    known = sorted(p.stem for p in (SHIPPED / kind).glob("*.yaml"))
    raise ConfigError(f"{name}: no such file, and none of the {kind} that ship ({', '.join(known)})")
