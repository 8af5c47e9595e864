"""What a request may name: runs and files below the runs folder, truths of the library. Nothing else is looked at."""

import os
import re
from pathlib import Path

from gonio.config import ConfigError

RUN = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}(/[A-Za-z0-9][A-Za-z0-9_.-]{0,99}){0,3}$"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")


def run_folder(runs: Path, name: str) -> Path:
    """The folder `name` below `runs`, links resolved. Raises ConfigError where it would lie elsewhere."""
    if not re.fullmatch(RUN.strip("^$"), name):
        raise ConfigError(f"run {name[:80]!r}: name a folder below the daemon's runs folder")
    folder = (runs / name).resolve()
    if not folder.is_relative_to(runs.resolve()):
        raise ConfigError(f"run {name[:80]!r}: leads out of the daemon's runs folder")
    return folder


def truth_name(runs: Path, truth: str) -> str:
    """`truth` as it may be opened: a material's name, or a file below `runs`. Raises ConfigError."""
    if NAME.fullmatch(truth):
        from gonio.brdf.library import available

        if any(found.name == truth for found in available()) and not os.path.lexists(truth):
            return truth
        raise ConfigError(f"truth {truth}: no such material; `gonio materials` lists what there is")
    return _file_below(runs, "truth", truth, "a daemon shows materials by name, or files in its runs folder")


def weights_file(runs: Path, path: str) -> str:
    """A flow's weights as they may be opened: a file below `runs`. Raises ConfigError."""
    advice = f"a daemon reads files in its runs folder; copy it into {runs.resolve()}, or use --no-daemon"
    return _file_below(runs, "sampler.flow.weights", path, advice)


def scene_file(runs: Path, path: str) -> str:
    """What a picture needs, as it may be opened: a file below `runs`. Raises ConfigError."""
    advice = f"a daemon reads files in its runs folder; copy it into {runs.resolve()}, or use --no-daemon"
    return _file_below(runs, "sampler.target.scene", path, advice)


def _file_below(runs: Path, key: str, path: str, advice: str) -> str:
    base = os.path.realpath(runs)
    lexical = os.path.normpath(os.path.join(base, path)) if "\0" not in path else ""
    if not lexical.startswith(base + os.sep) or not os.path.realpath(lexical).startswith(base + os.sep):
        raise ConfigError(f"{key} {path[:80]!r}: {advice}")
    if not os.path.exists(lexical):
        raise ConfigError(f"{key} {path[:80]!r}: no such file")
    return lexical


def relative(runs: Path, folder: Path) -> str:
    """How a client names `folder` to a daemon with this runs folder. Raises ConfigError where it lies elsewhere."""
    try:
        return folder.resolve().relative_to(runs.resolve()).as_posix()
    except ValueError:
        raise ConfigError(
            f"{folder}: the daemon keeps its runs in {runs}; name a folder there, or use --no-daemon"
        ) from None
