"""The control thread: the one that owns the rig. It does one job after another; others may pause or stop it.

    submit -> the thread runs the job -> the board says how it went

Pausing waits for a safe point: between two measurements, the last one stored. Stopping halts the motors at once, from
whichever thread asks, and again until the job has ended, since a motion that was just beginning would not have heard.
"""

import logging
import queue
import threading
import time
from collections.abc import Callable
from typing import Any

from gonio.acquire import Interrupted
from gonio.config.rig import RigConfig
from gonio.daemon import health
from gonio.daemon.rig_owner import RigOwner
from gonio.daemon.status_board import StatusBoard
from gonio.rig.errors import RigError

log = logging.getLogger("gonio.daemon")
Work = Callable[[RigOwner], dict[str, Any]]
HEALTH_S = 2.0
INSIST_S = 0.05


class Busy(Exception):
    """The rig does something else. One line; exit code 2."""

    exit_code = 2


class Control:
    """The rig's owner. Everything but `board.write` of a job may be called from any thread."""

    def __init__(self, config: RigConfig):
        self.config = config
        self.board = StatusBoard(_about(config))
        self.owner = RigOwner(config)
        self._jobs: queue.SimpleQueue[Work | None] = queue.SimpleQueue()
        self._claim = threading.Lock()
        self._stopped, self._idle, self._go_on = threading.Event(), threading.Event(), threading.Event()
        self._idle.set()
        self._go_on.set()
        self._looked = 0.0
        self._thread = threading.Thread(target=self._loop, name="rig", daemon=True)
        self._thread.start()

    # ---- asked from outside ----------------------------------------------------------------------------------------

    def submit(self, kind: str, prepare: Callable[[], tuple[Work, dict[str, Any]]]) -> int:
        """A new job; its number. `prepare` is called now, for errors that can be told at once. Raises Busy."""
        if not self._claim.acquire(blocking=False):
            raise Busy(f"rig {self.config.name}: another job is being prepared; try again")
        try:
            if doing := self.busy():
                raise Busy(doing)
            work, about = prepare()
            self._stopped.clear()
            self._go_on.set()
            self._idle.clear()
            number = self.board.begin({"kind": kind, **about})
            self._jobs.put(work)
            return number
        finally:
            self._claim.release()

    def busy(self) -> str:
        """What keeps the rig from a new job, in words; "" for nothing."""
        if self._idle.is_set():
            return ""
        doing = (self.board.state()["job"] or {}).get("kind", "something")
        return f"rig {self.config.name}: busy with {doing}; wait, or `gonio stop` it"

    def pause(self) -> bool:
        """The run holds after the measurement under way; False where nothing runs that can be paused."""
        job = self.board.state()["job"]
        if self._idle.is_set() or job is None or "run" not in job:
            return False
        self._go_on.clear()
        return True

    def go_on(self) -> bool:
        """The pause is over; False where there was none."""
        was = not self._go_on.is_set()
        self._go_on.set()
        return was

    def stop(self) -> bool:
        """Motors halt now, and the job ends; False where there was none (motors are told all the same)."""
        working = not self._idle.is_set()
        if working:
            self._stopped.set()
            self.board.write(state="stopping")
        self._halt()
        self._go_on.set()
        if working:
            threading.Thread(target=self._insist, name="stop", daemon=True).start()
        return working

    @property
    def stopped(self) -> bool:
        return self._stopped.is_set()

    def wait(self, seconds: float | None = None) -> bool:
        """Until no job is under way; whether that came true in time."""
        return self._idle.wait(seconds)

    def close(self) -> None:
        """Stop what runs, light off, devices let go."""
        self.stop()
        self._jobs.put(None)
        self._thread.join(15)

    # ---- called by jobs, in the control thread ---------------------------------------------------------------------

    def ask(self, what: str) -> None:
        """Holds here until `go_on`: the operator puts `what` in. Raises Interrupted for a stop."""
        self._go_on.clear()
        if not self.stopped:
            self.board.job(asks=what)
            self.board.write(state="paused")
            self._go_on.wait()
        self.board.job(asks="")
        if self.stopped:
            raise Interrupted
        self.board.write(state="running")

    def safe_point(self) -> None:
        """Holds here while paused."""
        if not self._go_on.is_set():
            self.board.write(state="paused")
            self._go_on.wait()
            if not self.stopped:
                self.board.write(state="running")
        self._quietly(self.look)  # what matters of it, the next move finds for itself

    def look(self, now: bool = False) -> None:
        """Device health on the board, every two seconds."""
        if self.owner.rig is not None and (now or time.monotonic() - self._looked > HEALTH_S):
            self._looked = time.monotonic()
            self.board.write(devices=health.devices(self.owner.rig))

    # ---- the thread ------------------------------------------------------------------------------------------------

    def _loop(self) -> None:
        while True:
            try:
                work = self._jobs.get(timeout=HEALTH_S)
            except queue.Empty:
                self._quietly(self.look)
                continue
            if work is None:
                break
            self._do(work)
        self._quietly(self.owner.close)

    def _do(self, work: Work) -> None:
        result: dict[str, Any] = {}
        code, message = 0, ""
        try:
            result = work(self.owner)
            if self.stopped:
                code, message = 130, "stopped by the operator"
        except Interrupted:
            code, message = 130, "stopped by the operator; all that was measured is stored"
        except Exception as e:
            code = getattr(e, "exit_code", 1)
            message = " ".join(str(e).split()) if hasattr(e, "exit_code") else f"bug: {type(e).__name__}: {e}"
            if not hasattr(e, "exit_code"):
                log.exception("a job failed")
            if code in (1, 3):  # what failed is opened, configured and checked anew by the next job
                self._quietly(self.owner.close)
        self._quietly(self.owner.dark)
        self._quietly(lambda: self.look(now=True))
        if (pose := result.get("pose_deg")) is not None:
            self.board.write(pose_deg=pose)
        self.board.job(ended=time.time(), code=code, message=message, result=result)
        self.board.write(state="fault" if code in (1, 3, 4, 5) else "idle")
        self._idle.set()

    def _halt(self) -> None:
        self._quietly(self.owner.stop)

    def _insist(self) -> None:
        while self.stopped and not self._idle.wait(INSIST_S):
            self._halt()

    def _quietly(self, act: Callable[[], Any]) -> None:
        """A second fault on the way out of a first one is for the log."""
        try:
            act()
        except (RigError, OSError) as e:
            log.warning("%s", e)
        except Exception:
            log.exception("while tidying up")


def _about(config: RigConfig) -> dict[str, Any]:
    axes = {
        n: {"lower_deg": config.axes[n].lower_deg, "upper_deg": config.axes[n].upper_deg} for n in config.axis_names
    }
    return {
        "name": config.name,
        "depth": config.depth,
        "simulated": config.depth != "real",
        "kinematics": config.kinematics.kind,
        "axes": axes,
    }
