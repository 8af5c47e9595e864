"""Where the pseudo-terminals of an emulated rig are named: a temporary folder that lasts as long as its process.

A process that is killed cannot clear up; whoever comes next does. A lock says whether the owner lives: the kernel lets
it go with the process, however that ends.
"""

import contextlib
import fcntl
import os
import shutil
import tempfile
from pathlib import Path

PREFIX = "gonio-wire-"
LOCK = ".owner"


class Folder:
    """`path`, held until `close`."""

    def __init__(self) -> None:
        clear_orphans()
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._fd = os.open(self.path / LOCK, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        fcntl.flock(self._fd, fcntl.LOCK_EX)

    def close(self) -> None:
        shutil.rmtree(self.path, ignore_errors=True)
        with contextlib.suppress(OSError):
            os.close(self._fd)


def clear_orphans() -> None:
    """Remove this user's folders whose owner is gone. One that was made a moment ago has no lock yet: it stays."""
    for path in Path(tempfile.gettempdir()).glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            if path.stat().st_uid == os.getuid() and _orphan(path):
                shutil.rmtree(path, ignore_errors=True)


def _orphan(path: Path) -> bool:
    try:
        fd = os.open(path / LOCK, os.O_RDWR | os.O_CLOEXEC)
    except FileNotFoundError:  # of a version that made no lock: its terminals are gone
        links = [p for p in path.iterdir() if p.is_symlink()]
        return bool(links) and not any(p.exists() for p in links)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        return True
    except BlockingIOError:
        return False
    finally:
        os.close(fd)
