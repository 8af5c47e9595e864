"""The queue of a rig, in a file of the daemon's runs folder: whole after a kill at any moment."""

import threading
import time
from pathlib import Path
from typing import Literal

from pydantic import ValidationError

from gonio.atomic import write_text
from gonio.config import ConfigError, Material
from gonio.config.loader import Section
from gonio.config.scan import Scan

MOST = 1000
MOST_BYTES = 200_000_000
OPEN = ("waiting", "running")


class Entry(Section):
    """One sample: the run to make of it, and what became of it. run: its folder below the runs folder, once begun."""

    id: int
    material: Material
    scan: Scan | None = None
    added: float
    state: Literal["waiting", "running", "done", "failed"] = "waiting"
    run: str = ""
    message: str = ""

    @property
    def label(self) -> str:
        """What the operator looks for: the material's name, and the sample's label where it has one."""
        m = self.material
        return m.name if m.sample_id is None else f"{m.name} ({m.sample_id})"


class Saved(Section):
    """The file. active: the daemon works it off; ask: whether it waits for the operator before each sample."""

    format: Literal[1] = 1
    active: bool = False
    ask: bool = True
    next_id: int = 1
    entries: tuple[Entry, ...] = ()


class Entries:
    """Kept in memory and on disk alike; every change is on disk when it returns. Safe from any thread."""

    def __init__(self, path: Path):
        self.path = path
        self.changed = threading.Condition()
        self._saved = _read(path)

    @property
    def saved(self) -> Saved:
        return self._saved

    def find(self, number: int) -> Entry:
        """Raises ConfigError where there is none."""
        for entry in self._saved.entries:
            if entry.id == number:
                return entry
        raise ConfigError(f"queue: no entry {number}; `gonio queue list` shows them")

    def next(self) -> Entry | None:
        """The one that was begun, or the first that waits."""
        left = [e for e in self._saved.entries if e.state in OPEN]
        return next((e for e in left if e.state == "running"), left[0] if left else None)

    def add(self, material: Material, scan: Scan | None = None) -> Entry:
        with self.changed:
            if len(self._saved.entries) >= MOST:
                raise ConfigError(f"queue: {MOST} entries, no more fit; `gonio queue remove` takes those that are done")
            entry = Entry(id=self._saved.next_id, material=material, scan=scan, added=time.time())
            self._keep(next_id=entry.id + 1, entries=(*self._saved.entries, entry))
            return entry

    def change(self, number: int, **what: str) -> Entry:
        with self.changed:
            entry = self.find(number).model_copy(update=what)
            self._keep(entries=tuple(entry if e.id == number else e for e in self._saved.entries))
            return entry

    def move(self, number: int, place: int) -> None:
        """To `place` among those that wait, 1 = next. Raises ConfigError for one that does not wait."""
        with self.changed:
            entry = self.find(number)
            if entry.state != "waiting":
                raise ConfigError(f"queue: entry {number} is {entry.state}; only those that wait can be moved")
            others = [e for e in self._saved.entries if e.id != number]
            waiting = [k for k, e in enumerate(others) if e.state == "waiting"]
            at = waiting[place - 1] if 1 <= place <= len(waiting) else len(others)
            self._keep(entries=(*others[:at], entry, *others[at:]))

    def remove(self, number: int) -> None:
        """Its run folder stays. Raises ConfigError for one under way."""
        with self.changed:
            entry = self.find(number)
            if entry.state == "running" and self._saved.active:
                raise ConfigError(f"queue: entry {number} is under way; `gonio stop` ends it first")
            self._keep(entries=tuple(e for e in self._saved.entries if e.id != number))

    def work(self, active: bool, ask: bool | None = None) -> None:
        with self.changed:
            self._keep(active=active, ask=self._saved.ask if ask is None else ask)

    def _keep(self, **changes) -> None:
        saved = self._saved.model_copy(update=changes)
        try:
            write_text(self.path, saved.model_dump_json())
        except OSError as e:
            raise ConfigError(f"{self.path}: {e.strerror}; nothing was changed") from None
        self._saved = saved
        self.changed.notify_all()


def _read(path: Path) -> Saved:
    """Raises ConfigError for what is no queue."""
    try:
        if not path.exists():
            return Saved()
        if path.stat().st_size > MOST_BYTES:
            raise ConfigError(f"{path}: too large for a queue; move it away")
        return Saved.model_validate_json(path.read_bytes())
    except (ValidationError, ValueError, RecursionError) as e:
        if isinstance(e, ConfigError):
            raise
        what = " ".join(str(e).split())[:120]
        raise ConfigError(f"{path}: damaged, or of a newer gonio ({what}); move it away to begin anew") from None
    except OSError as e:
        raise ConfigError(f"{path}: {e.strerror}; move it away to begin a new queue") from None
