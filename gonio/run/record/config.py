"""config.yaml of a run folder: everything resolved, so that a run says by itself how it was made."""

import json
import os
from pathlib import Path

import yaml

from gonio.atomic import write_text
from gonio.config import ConfigError, Material
from gonio.config.loader import Section, parse_config
from gonio.config.rig import RigConfig


class Imported(Section):
    """Where the readings of a run come from that gonio did not measure, and how the file was understood."""

    files: tuple[str, ...]
    sha256: tuple[str, ...]
    format: str
    quantity: str
    mapping: dict[str, str]
    said: tuple[str, ...] = ()


class RunConfig(Section):
    """What a run was started with; of an imported one the rig is a stand-in."""

    material: Material
    rig: RigConfig
    imported: Imported | None = None


def read_config(folder: str | os.PathLike[str], overrides: tuple[str, ...] = ()) -> RunConfig:
    path = Path(folder) / "config.yaml"
    try:
        text = path.read_text()
    except OSError as e:
        raise ConfigError(f"{path}: {e.strerror}; name a run folder that `gonio acquire` made") from None
    if not _says_its_target(text):
        overrides = ("material.sampler.target.kind=energy", *overrides)
    return parse_config(text, RunConfig, overrides, source=str(path))


def _says_its_target(text: str) -> bool:
    """Whether a run says what its chain's target is; runs made when there was only one do not."""
    try:
        target = yaml.safe_load(text)["material"]["sampler"]["target"]
    except (yaml.YAMLError, TypeError, KeyError):
        return True  # not a run's config; what is wrong with it is said where it is read
    return "kind" in target if isinstance(target, dict) else True


def write_config(folder: str | os.PathLike[str], config: RunConfig) -> None:
    """Whole or not at all: a process killed here leaves the config that was there before."""
    write_text(Path(folder) / "config.yaml", dump(config))


def dump(config: RunConfig) -> str:
    said = json.loads(config.model_dump_json())
    if said["imported"] is None:
        del said["imported"]
    return yaml.safe_dump(said, sort_keys=False)
