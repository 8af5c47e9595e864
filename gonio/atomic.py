"""Files that appear whole or not at all: written beside, synced to the disk, renamed."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO


@contextmanager
def beside(path: str | os.PathLike) -> Iterator[Path]:
    """A file's name to write to, in the folder of `path` and with its suffix; it takes its place when the block ends.

    For libraries that want a name. Until then `path` is untouched; after an error (a full disk, Ctrl-C) nothing is
    left behind. Raises OSError.
    """
    path = Path(path)
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
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(part, 0o666 & ~umask)  # mkstemp makes files that only their owner may read
        os.replace(part, path)
        _sync_folder(path.parent)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


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
