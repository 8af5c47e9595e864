"""What the file system does for a run folder: one writer's lock, its database, and errors that say what to do."""

import contextlib
import fcntl
import json
import os
import sqlite3
from collections.abc import Iterator, Sequence
from pathlib import Path


class StoreError(Exception):
    """A run folder that cannot be used or written: which, why, what to do. One line; exit code 2."""

    exit_code = 2


def refuse_folder(folder: Path) -> None:
    """Raises StoreError where a new run cannot be put."""
    try:
        if os.path.lexists(folder):
            raise StoreError(
                f"{folder}: exists already; name a new folder with --out, or go on with `gonio resume {folder}`"
            )
        folder.absolute().stat()  # a name too long, or below a file or a folder that is closed to us
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as e:
        why = getattr(e, "strerror", None) or e
        raise StoreError(f"{folder}: {why}; name another folder with --out") from None
    above = next(p for p in folder.absolute().parents if p.exists())
    if not above.is_dir() or not os.access(above, os.W_OK | os.X_OK):
        raise StoreError(f"{folder}: cannot be made in {above}; name another folder with --out")


def connect(path: Path, power_safe: bool) -> sqlite3.Connection:
    """power_safe: whether a commit waits until the disk has it."""
    db = sqlite3.connect(path, timeout=5, check_same_thread=False)
    db.execute("PRAGMA journal_mode=WAL")
    db.execute(f"PRAGMA synchronous={'FULL' if power_safe else 'NORMAL'}")
    return db


def take_lock(folder: Path) -> int:
    """One writer a run: an advisory lock that dies with its process, however that ends. Raises StoreError."""
    fd = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o644)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(fd)
        raise StoreError(f"{folder}: in use by another process; wait for it or stop it, then try again") from None
    return fd


@contextlib.contextmanager
def explained(folder: Path) -> Iterator[None]:
    """What SQLite and the file system raise becomes a StoreError with a remedy."""
    try:
        yield
    except sqlite3.OperationalError as e:
        cause = str(e)
        remedy = (
            "free some space, then `gonio resume` goes on with what was stored"
            if "full" in cause or "I/O" in cause
            else "check the folder"
        )
        raise StoreError(f"{folder}/run.sqlite: {cause}; {remedy}") from None
    except (sqlite3.DatabaseError, TypeError, json.JSONDecodeError) as e:
        raise StoreError(f"{folder}/run.sqlite: damaged or not a run ({e}); restore it from a copy") from None
    except OSError as e:
        raise StoreError(f"{folder}: {e.strerror}; check space and permissions") from None


def remove(folder: Path, made: Sequence[Path]) -> None:
    """Delete the folder, and those above it that were made for it and are empty again."""
    for path in folder.iterdir():
        path.unlink()
    folder.rmdir()
    remove_empty(made)


def remove_empty(made: Sequence[Path]) -> None:
    """Delete those of the folders that are empty, innermost first."""
    with contextlib.suppress(OSError):
        for parent in made:
            parent.rmdir()
