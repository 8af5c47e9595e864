"""`gonio daemon`: the rig in one thread, the web in another, signals in the main one."""

import asyncio
import logging
import secrets
import signal
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gonio.config.rig import RigConfig
from gonio.daemon import sockets
from gonio.daemon.control import Control
from gonio.export.extra import needs

log = logging.getLogger("gonio.daemon")


class Web:
    """Serves an app on sockets, in a thread of its own that is started again should it die."""

    def __init__(self, served: list[tuple[Any, socket.socket]]):
        self._served = served
        self._closed = False
        self.loop: asyncio.AbstractEventLoop | None = None
        self._servers: list[Any] = []
        self.start()

    def start(self) -> None:
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)
        self._thread.start()

    def keep(self) -> None:
        """Start it again if it has died."""
        if not self._thread.is_alive() and not self._closed:
            log.warning("the web thread died; started again")
            self.start()

    def close(self) -> None:
        self._closed = True
        for server in self._servers:
            server.should_exit = True
        self._thread.join(3)
        for _, sock in self._served:
            sock.close()

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except Exception:
            log.exception("the web thread")

    async def _serve(self) -> None:
        import uvicorn

        self.loop = asyncio.get_running_loop()
        self._servers = []
        for app, _ in self._served:
            config = uvicorn.Config(
                app, log_level="warning", access_log=False, lifespan="off", timeout_graceful_shutdown=1, ws="none"
            )
            self._servers.append(uvicorn.Server(config))
        # a server closes its socket when it ends: each gets one to keep
        sockets = [sock.dup() for _, sock in self._served]
        await asyncio.gather(*(s.serve(sockets=[k]) for s, k in zip(self._servers, sockets)))


def serve(config: RigConfig, runs: Path, tcp: int | None, say: Callable[[str], None]) -> None:
    """Own the rig until told to end (SIGTERM, SIGINT): then motors halt, the run is stored, the light goes off.

    tcp: None = Unix socket only; else also this port on 127.0.0.1 (0 = any), with a random token.
    Raises SocketsError where the rig is taken, MissingExtra.
    """
    needs("fastapi", "daemon")
    needs("uvicorn", "daemon")
    from gonio.daemon.auth import TokenOnly
    from gonio.daemon.queue.worker import Queue
    from gonio.daemon.server import make_app

    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
    over = threading.Event()
    with sockets.hold(config):
        path = sockets.socket_path(config.name)
        control = Control(config)

        def end(number: int, frame: Any) -> None:
            over.set()

        before = {s: signal.signal(s, end) for s in (signal.SIGTERM, signal.SIGINT)}
        runs.mkdir(parents=True, exist_ok=True)
        queue = Queue(control, runs)
        app = make_app(control, runs, queue)
        served: list[tuple[Any, socket.socket]] = [(app, sockets.listen(path))]
        say(f"rig   {config.name} ({config.depth}) on {path}")
        if tcp is not None:
            token = secrets.token_urlsafe(24)
            served.append((TokenOnly(app, token), _loopback(tcp)))
            say(f"page  http://127.0.0.1:{served[1][1].getsockname()[1]}/?token={token}")
        web = Web(served)
        queue.start()
        try:
            while not over.wait(0.5):
                web.keep()
        finally:
            queue.end()
            control.close()
            queue.close()
            web.close()
            path.unlink(missing_ok=True)
            for s, handler in before.items():
                signal.signal(s, handler)
    say("ended")


def _loopback(port: int) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind(("127.0.0.1", port))
    except (OSError, OverflowError) as e:
        sock.close()
        raise sockets.SocketsError(f"--tcp {port}: {e}; take another port") from None
    sock.listen(64)
    return sock
