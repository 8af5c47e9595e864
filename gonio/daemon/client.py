"""The command line's side: is there a daemon for this rig, ask it, wait for its job."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gonio.config import ConfigError
from gonio.daemon.sockets import SocketsError, folder, socket_path
from gonio.export.extra import needs

POLL_S = 0.1


class Gone(Exception):
    """The daemon does not answer any more; what was measured is stored."""

    exit_code = 130


class Refused(Exception):
    """The daemon's own words, with the exit code that it named."""

    def __init__(self, text: str, code: int):
        super().__init__(text)
        self.exit_code = code


class Client:
    """One daemon."""

    def __init__(self, rig: str, path: Path):
        httpx = needs("httpx", "daemon")
        self.rig = rig
        self._error: type[Exception] = httpx.HTTPError
        self._http = httpx.Client(
            transport=httpx.HTTPTransport(uds=str(path)), base_url="http://gonio", timeout=10, trust_env=False
        )

    def state(self) -> dict[str, Any]:
        return self.get("/state")

    def get(self, path: str) -> dict[str, Any]:
        return self._ask("GET", path)

    def post(self, path: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
        """Raises Refused, Gone."""
        return self._ask("POST", path, body)

    def wait(
        self, job: int, watch: Callable[[dict[str, Any]], None] = lambda state: None, interrupted=lambda: False
    ) -> dict[str, Any]:
        """The job's entry once it has ended; asked to stop, it is stopped. Raises Gone, and Refused for its failure."""
        asked = False
        while True:
            state = self.state()
            entry = state["job"] or {}
            if entry.get("id") == job:
                watch(state)
            if entry.get("id") != job or entry["ended"] is not None:
                break
            if interrupted() and not asked:
                asked = True
                self.post("/stop")
            time.sleep(POLL_S)
        if entry.get("id") == job and entry["code"]:
            raise Refused(entry["message"], entry["code"])
        return entry

    def _ask(self, method: str, path: str, body: dict[str, Any] | None = None) -> dict[str, Any]:
        try:
            answer = self._http.request(method, path, json=body)
            found = answer.json()
        except (self._error, ValueError) as e:
            raise Gone(
                f"rig {self.rig}: its daemon does not answer ({type(e).__name__}); start it again, "
                "then `gonio resume` goes on with what was stored"
            ) from None
        if answer.status_code >= 400:
            raise Refused(found.get("detail", answer.text), found.get("code", 1))
        return found


def find(rig: str) -> Client | None:
    """The daemon of this rig, None where none runs."""
    try:
        path = socket_path(rig)
    except SocketsError:
        return None
    return Client(rig, path) if _answers(path) else None


def running() -> list[str]:
    """Names of the rigs that a daemon of this user drives."""
    return sorted(p.stem for p in folder().glob("*.sock") if _answers(p))


def the_one(rig: str | None) -> Client:
    """The daemon of `rig`, or the only one. Raises ConfigError."""
    names = running() if rig is None else [rig]
    if len(names) > 1:
        raise ConfigError(f"daemons drive {', '.join(names)}; say which with --rig")
    client = find(names[0]) if names else None
    if client is None:
        raise ConfigError(f"no daemon runs{f' for rig {rig}' if rig else ''}; start one with `gonio daemon --rig R`")
    return client


def _answers(path: Path) -> bool:
    import socket

    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as s:
        s.settimeout(1)
        try:
            s.connect(str(path))
        except OSError:
            return False
    return True
