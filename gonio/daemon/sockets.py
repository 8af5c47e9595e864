"""Where a daemon is found, and that there is only one: sockets and locks in a folder that is the user's alone."""

import contextlib
import fcntl
import os
import re
import socket
import stat
import tempfile
from collections.abc import Iterator
from pathlib import Path

from gonio.config.plugins import DetectorSection
from gonio.config.rig import RigConfig


class SocketsError(Exception):
    """The rig is taken, or the folder cannot be used. One line; exit code 2."""

    exit_code = 2


def folder() -> Path:
    """$XDG_RUNTIME_DIR/gonio, or a folder of the user's in the temporary one; made with mode 0700.

    Raises SocketsError where it is not the user's, or open to others.
    """
    base = os.environ.get("XDG_RUNTIME_DIR")
    path = Path(base) / "gonio" if base else Path(tempfile.gettempdir()) / f"gonio-{os.getuid()}"
    try:
        path.mkdir(mode=0o700, exist_ok=True)
        found = path.lstat()
    except OSError as e:
        raise SocketsError(f"{path}: {e.strerror}; set XDG_RUNTIME_DIR to a folder of your own") from None
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
        raise SocketsError(f"{path}: not yours alone (mode 0700 is needed); set XDG_RUNTIME_DIR to another")
    return path


def socket_path(rig: str) -> Path:
    """The socket of the daemon of this rig."""
    return folder() / f"{rig}.sock"


@contextlib.contextmanager
def hold(config: RigConfig) -> Iterator[None]:
    """This process drives the rig, and the ports it is on. Raises SocketsError where another does."""
    detector = config.detector
    ports = [*config.devices.ports, *(detector.ports if isinstance(detector, DetectorSection) else ())]
    names = [f"rig-{config.name}", *(f"port-{re.sub('[^A-Za-z0-9]+', '_', os.path.realpath(p))}" for p in ports)]
    with contextlib.ExitStack() as held:
        for name in dict.fromkeys(names):
            fd = os.open(folder() / f"{name}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
            held.callback(os.close, fd)
            try:
                fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise SocketsError(
                    f"rig {config.name}: another process drives it ({name}); `gonio status` shows it"
                ) from None
        yield


def hold_hardware(config: RigConfig) -> contextlib.AbstractContextManager[None]:
    """`hold` for a command that opens the rig itself; of a simulated rig, any number may run side by side."""
    return hold(config) if config.depth == "real" else contextlib.nullcontext()


def listen(path: Path) -> socket.socket:
    """A Unix socket of mode 0600. To be called with the rig held: one left behind by a killed daemon is replaced."""
    if len(os.fsencode(path)) > 100:
        raise SocketsError(f"{path}: too long for a socket; set XDG_RUNTIME_DIR to a shorter one")
    with contextlib.suppress(FileNotFoundError):
        path.unlink()
    sock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    before = os.umask(0o177)
    try:
        sock.bind(str(path))
    finally:
        os.umask(before)
    sock.listen(64)
    return sock
