"""Files that appear whole or not at all: written beside, synced to the disk, renamed."""

import glob
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

FOLDER_PART = ".gonio.part"  # no other program's: what is swept is ours
ABANDONED_S = 86400.0  # a part this old is of a process that was killed


@contextmanager
def beside(path: str | os.PathLike) -> Iterator[Path]:
    """A file's name to write to, in the folder of `path` and with its suffix; it takes its place when the block ends.

    For libraries that want a name. Until then `path` is untouched; after an error (a full disk, Ctrl-C) nothing is
    left behind. Raises OSError.
    """
    path = Path(path)
    _sweep(path.parent, f".{glob.escape(path.stem)}.*.part{glob.escape(path.suffix)}")
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}.", suffix=f".part{path.suffix}")
    os.close(handle)
    part = Path(name)
    try:
        yield part
        handle = os.open(part, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)
        os.chmod(part, 0o666 & ~_umask())  # mkstemp makes files that only their owner may read
        os.replace(part, path)
        _sync_folder(path.parent)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


@contextmanager
def folder_beside(path: str | os.PathLike) -> Iterator[Path]:
    """An empty folder beside `path` that becomes it when the block ends; after an error nothing is left behind.

    Raises OSError, also where there is something else at `path` by then.
    """
    path = Path(path)
    _sweep(path.parent, f".*{FOLDER_PART}")
    part = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}.", suffix=FOLDER_PART))
    try:
        yield part
        os.chmod(part, 0o777 & ~_umask())
        os.rename(part, path)
        _sync_folder(path.parent)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def _umask() -> int:
    umask = os.umask(0)
    os.umask(umask)
    return umask


def _sweep(folder: Path, pattern: str) -> None:
    """Delete what killed processes left of `pattern` in the folder."""
    for part in folder.glob(pattern):
        with suppress(OSError):
            if time.time() - part.stat().st_mtime > ABANDONED_S:
                shutil.rmtree(part) if part.is_dir() else part.unlink()


def _sync_folder(folder: Path) -> None:
    """The new name too is on the disk; where the file system cannot say so, it is left to it."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


@contextmanager
def replacing(path: str | os.PathLike) -> Iterator[BinaryIO]:
    """A binary file to write to that takes the place of `path` when the block ends without an error. Raises OSError."""
    with beside(path) as part, open(part, "wb") as stream:
        yield stream


def write_text(path: str | os.PathLike, text: str) -> None:
    """`text` in UTF-8 in the place of what was at `path`. Raises OSError."""
    with replacing(path) as stream:
        stream.write(text.encode())
