"""The thread that works the queue off: one entry after another through the control thread, as an operator would.

    the next entry -> ask for its sample (the job is paused and says its name) -> run -> done -> the next

What was begun when the daemon was killed is gone on with, by the daemon that is started next. A fault or a stop ends
the work, not the entry: `gonio queue run` goes on with it.
"""

import logging
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from gonio.daemon import manual
from gonio.daemon.control import Busy, Control, Work
from gonio.daemon.jobs import driven
from gonio.daemon.queue.entries import Entries, Entry
from gonio.daemon.request_paths import run_folder
from gonio.daemon.rig_owner import RigOwner
from gonio.run.prepare import new_name, prepare
from gonio.run.start import Run, resume, start

log = logging.getLogger("gonio.daemon")
MAKE = """
import sys
from pathlib import Path
from gonio.run.products import make_products
make_products(Path(sys.argv[1]))
"""
REFUSED = (2,)  # exit codes that are the entry's own fault: the next may do better


class Queue:
    """The queue of one rig; `start` has it worked off whenever it is active."""

    def __init__(self, control: Control, runs: Path):
        self.control, self.runs = control, runs
        self.entries = Entries(runs / f"queue-{control.config.name}.json")
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self._making: list[subprocess.Popen] = []
        self.show()

    def start(self) -> None:
        self._thread = threading.Thread(target=self._loop, name="queue", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Before the control thread is closed: nothing new is begun, and what stops now was not stopped by anybody."""
        self._over.set()

    def close(self) -> None:
        """After it: what ran has been stored, and is gone on with by the next daemon."""
        with self.entries.changed:
            self.entries.changed.notify_all()
        if self._thread is not None:
            self._thread.join(5)
        for process in self._making:
            process.terminate()

    def show(self) -> None:
        """What watchers are told of it."""
        saved = self.entries.saved
        waiting = sum(e.state == "waiting" for e in saved.entries)
        self.control.board.write(queue={"active": saved.active, "waiting": waiting})

    def _loop(self) -> None:
        while not self._over.is_set():
            entry = self._next()
            if entry is None or self._over.is_set():
                continue
            try:
                self._do(entry)
            except Exception:  # the thread outlives any entry: the work ends, the log says why, the queue is kept
                log.exception("the queue")
                self.entries.work(False)
            self.show()

    def _next(self) -> Entry | None:
        """Waits until there is something to do."""
        with self.entries.changed:
            while not self._over.is_set():
                entry = self.entries.next() if self.entries.saved.active else None
                if entry is not None:
                    return entry
                if self.entries.saved.active:
                    self.entries.work(False)  # all done
                    self.show()
                self.entries.changed.wait()
        return None

    def _do(self, entry: Entry) -> None:
        """One entry, to its end."""
        try:
            job = self.control.submit("queue", lambda: self._job(entry))
        except Busy:
            self.control.wait(1.0)
            return
        except Exception as e:
            if not hasattr(e, "exit_code"):
                raise
            self._ended(entry.id, {"code": e.exit_code, "message": " ".join(str(e).split())})
            return
        self.show()
        self.control.wait()
        if self._over.is_set():
            return
        ended = self.control.board.state()["job"] or {}
        if ended.get("id") == job:
            self._ended(entry.id, ended)

    def _ended(self, number: int, job: dict[str, Any]) -> None:
        if all(e.id != number for e in self.entries.saved.entries):
            return  # taken out while its sample was asked for
        if job["code"] == 0:
            done = self.entries.change(number, state="done", message=job["result"]["reason"])
            self._make(run_folder(self.runs, done.run))
        elif job["code"] in REFUSED:
            self.entries.change(number, state="failed", message=job["message"])
        else:  # the entry is not to blame, and can be gone on with
            self.entries.change(number, message=job["message"])
            self.entries.work(False)

    def _job(self, entry: Entry) -> tuple[Work, dict[str, Any]]:
        """As `control.submit` wants it; what the config of an entry is refused for is raised now."""
        if entry.state == "waiting":
            prepare(entry.material, self.control.config)

        def work(owner: RigOwner) -> dict[str, Any]:
            begun = entry
            if begun.state == "waiting":
                if self.entries.saved.ask:
                    self._out_of_the_way(owner)
                    self.control.ask(entry.label)
                name = f"{entry.material.name}/{new_name()}"
                begun = self.entries.change(entry.id, state="running", run=name, message="")
            drive, about = driven(self.control, self._open(begun))
            self.control.board.job(**about)
            return drive(owner)

        return work, {"material": entry.material.name, "entry": entry.id}

    def _out_of_the_way(self, owner: RigOwner) -> None:
        """Light off and arms at rest, where the rig is open: a hand reaches in now."""
        if owner.rig is not None and hasattr(owner.rig, "park"):
            self.control.board.write(pose_deg=manual.park(owner)["pose_deg"])

    def _open(self, entry: Entry) -> Run:
        """Its run, begun or gone on with."""
        folder = run_folder(self.runs, entry.run)
        if (folder / "run.sqlite").exists():
            return resume(folder)
        return start(entry.material, self.control.config, folder, scan=entry.scan)

    def _make(self, folder: Path) -> None:
        """BRDF and report, in a process of their own: the rig goes on meanwhile."""
        self._making = [p for p in self._making if p.poll() is None]
        none = subprocess.DEVNULL
        command = [sys.executable, "-c", MAKE, str(folder)]
        self._making.append(subprocess.Popen(command, stdin=none, stdout=none, stderr=none))
