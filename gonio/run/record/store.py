"""The run folder: one SQLite file (WAL) that holds all that was measured, and what it takes to go on.

    runs/<material>/<UTC stamp>-<short id>/   config.yaml  run.sqlite  log.txt  brdf.npz  brdf.bsdf  report.html

A measurement is committed before the next motion begins; an ideal rig, whose motions take no time, commits at most
50 ms apart. What that survives: a process killed at any moment, always. A power cut, where the readings are of a real
sample (`synchronous=FULL`: the disk has them); simulated readings (`NORMAL`) may lose those since the last checkpoint
then, and the file is whole all the same. No state of the chain is kept: what a chain does follows from its seed and the
answers it got, so that telling it the stored answers again makes it the chain it was (gonio.acquire.replay).
"""

import contextlib
import json
import os
import sqlite3
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gonio.atomic import folder_beside, write_text
from gonio.geometry import Array
from gonio.run.record.folder import StoreError, connect, explained, refuse_folder, remove, remove_empty, take_lock
from gonio.run.record.schema import FORMAT, RIG, SCHEMA, STEP_COLUMNS, SUSPECTS, Measured, numbers


class Store:
    """An open run. `create` makes the folder, `open` goes on with one; both hold its lock until `close`.

    commit_interval: seconds, 0 = each addition by itself. power_safe: whether a commit waits for the disk.
    """

    def __init__(self, folder: Path, db: sqlite3.Connection, lock: int | None, commit_interval: float):
        self.folder, self._db, self._lock, self._interval = folder, db, lock, commit_interval
        self._began = time.monotonic()
        self._last_commit = self._began
        self._wall_before = 0.0
        self._kept: dict[str, Any] = {}  # parts of the rig's state, as written last
        self._made: list[Path] | None = None  # folders above it that `create` made; None where it was there before
        self._closed = False

    @classmethod
    def create(
        cls,
        folder: str | os.PathLike[str],
        config_yaml: str,
        provenance: dict[str, Any],
        *,
        commit_interval: float = 0.0,
        power_safe: bool = True,
    ) -> "Store":
        """A new run. Raises StoreError where the folder exists or cannot be made."""
        folder = Path(folder)
        made = [p for p in folder.parents if not p.exists()]
        refuse_folder(folder)
        meta = {"format": FORMAT, "provenance": provenance, "ended": ""}
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
        except OSError as e:
            raise StoreError(f"{folder}: {e.strerror}; name another folder with --out") from None
        try:
            with explained(folder), folder_beside(folder) as part:
                lock = take_lock(part)
                write_text(part / "config.yaml", config_yaml)
                with contextlib.closing(connect(part / "run.sqlite", power_safe)) as db:
                    db.executescript(SCHEMA + SUSPECTS)
                    db.executemany("INSERT INTO meta VALUES (?, ?)", [(k, json.dumps(v)) for k, v in meta.items()])
                    db.commit()
        except StoreError:
            remove_empty(made)
            raise
        db = connect(folder / "run.sqlite", power_safe)
        store = cls(folder, db, lock, commit_interval)
        store._made = made
        return store

    @classmethod
    def open(
        cls, folder: str | os.PathLike[str], *, write: bool, commit_interval: float = 0.0, power_safe: bool = True
    ) -> "Store":
        """An existing run, to read or to go on with. Raises StoreError: no run, newer format, in use, damaged."""
        folder = Path(folder)
        path = folder / "run.sqlite"
        if not path.is_file():
            raise StoreError(f"{folder}: not a run folder (no run.sqlite in it); name one that `gonio acquire` made")
        with explained(folder):
            lock = take_lock(folder) if write else None
            try:
                db = connect(path, power_safe)
                if write:
                    db.executescript(SUSPECTS)
                found = json.loads(db.execute("SELECT value FROM meta WHERE key = 'format'").fetchone()[0])
            except BaseException:
                if lock is not None:
                    os.close(lock)
                raise
        if found > FORMAT:
            db.close()
            if lock is not None:
                os.close(lock)
            raise StoreError(
                f"{folder}: written by a newer gonio (run format {found}, this one reads {FORMAT}); update gonio"
            )
        store = cls(folder, db, lock, commit_interval)
        store._wall_before = db.execute("SELECT coalesce(max(wall_s), 0) FROM measurements").fetchone()[0]
        return store

    # ---- writing ---------------------------------------------------------------------------------------------------

    def add(self, ids, asked: Array, seen: Array, f: Array, sigma: Array, saturated, raw, rig_s) -> None:
        """Measurements (M rows), as in `Measured`; on disk on return unless a commit interval was given."""
        wall = self.wall_s()
        texts = [json.dumps(r) for r in raw] if len(raw) else [None] * len(ids)
        rows = [
            (int(i), a.tobytes(), s.tobytes(), v.tobytes(), e.tobytes(), int(sat), text, float(t), wall)
            for i, a, s, v, e, sat, text, t in zip(ids, asked, seen, f, sigma, saturated, texts, rig_s)
        ]
        with self._writing():
            self._db.executemany("INSERT INTO measurements VALUES (?,?,?,?,?,?,?,?,?)", rows)
        self._maybe_commit()

    def add_steps(self, steps) -> None:
        """Rows of the step log (`gonio.mcmc.chain.steps.Steps`); a row written before is written again, the same."""
        if len(steps):
            columns = [getattr(steps, k).tolist() for k in STEP_COLUMNS]
            both = np.concatenate([steps.wi, steps.wo], 1)
            proposed = [d.tobytes() if free else None for d, free in zip(both, steps.id < 0)]
            with self._writing():
                self._db.executemany("INSERT OR REPLACE INTO steps VALUES (?,?,?,?,?,?,?,?,?)", zip(*columns, proposed))

    def suspect(self, ids: Sequence[int], reason: str) -> None:
        """Measurements that may be wrong: kept apart, to be made again; the chain's steps from the first on go."""
        marks = ",".join("?" * len(ids))
        with self._writing():
            self._db.execute(
                f"INSERT INTO suspects SELECT *, ? FROM measurements WHERE id IN ({marks})", (reason, *ids)
            )
            self._db.execute(f"DELETE FROM measurements WHERE id IN ({marks})", tuple(ids))
            first = f"SELECT min(step) FROM steps WHERE step >= 0 AND id IN ({marks})"
            self._db.execute(f"DELETE FROM steps WHERE step >= ({first})", tuple(ids))
        self.commit()

    def suspects(self) -> dict[int, str]:
        """Why, by id, of measurements kept apart; one that was made again since is among them still."""
        with explained(self.folder), contextlib.suppress(sqlite3.OperationalError):  # made before there were any
            return dict(self._db.execute("SELECT id, reason FROM suspects").fetchall())
        return {}

    def event(self, kind: str, text: str) -> None:
        """A line for the record: started, resumed, fault, stopped …; also in log.txt."""
        with self._writing():
            self._db.execute("INSERT INTO events VALUES (?,?,?)", (self.wall_s(), kind, text))
            with open(self.folder / "log.txt", "a") as log:
                log.write(f"{time.strftime('%Y-%m-%dT%H:%M:%SZ', time.gmtime())} {kind}: {text}\n")

    def put(self, key: str, value: Any) -> None:
        with self._writing():
            self._db.execute("INSERT OR REPLACE INTO meta VALUES (?,?)", (key, json.dumps(value)))

    def keep(self, state: Mapping[str, Any]) -> None:
        """The rig's state, in parts; a part that is what it was is not written again."""
        changed = {k: v for k, v in state.items() if k not in self._kept or self._kept[k] != v}
        with self._writing():
            rows = [(RIG + k, json.dumps(v)) for k, v in changed.items()]
            self._db.executemany("INSERT OR REPLACE INTO meta VALUES (?,?)", rows)
        self._kept |= changed

    def commit(self) -> None:
        with self._writing():
            self._db.commit()
        self._last_commit = time.monotonic()

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """A measurement and the rig's state go together: where one cannot be written, neither is."""
        with explained(self.folder):
            try:
                yield
            except sqlite3.Error:
                self._kept = {}
                with contextlib.suppress(sqlite3.Error):
                    self._db.rollback()
                raise

    def _maybe_commit(self) -> None:
        if time.monotonic() - self._last_commit >= self._interval:
            self.commit()

    # ---- reading ---------------------------------------------------------------------------------------------------

    def get(self, key: str, default: Any = None) -> Any:
        with explained(self.folder):
            row = self._db.execute("SELECT value FROM meta WHERE key = ?", (key,)).fetchone()
        return default if row is None else json.loads(row[0])

    def kept(self) -> dict[str, Any]:
        """The rig's state, as kept last; empty where there is none."""
        with explained(self.folder):
            rows = self._db.execute("SELECT key, value FROM meta WHERE key GLOB ?", (RIG + "*",)).fetchall()
        return {key.removeprefix(RIG): json.loads(value) for key, value in rows}

    def measured(self) -> Measured:
        with explained(self.folder):
            rows = self._db.execute(
                "SELECT id, asked, seen, f, sigma, saturated, rig_s, wall_s FROM measurements ORDER BY id"
            ).fetchall()
        columns = list(zip(*rows)) if rows else [()] * 8
        asked, seen, f, sigma = (numbers(c, n) for c, n in zip(columns[1:5], (6, 6, 1, 1)))
        ids, saturated, rig_s, wall_s = (
            np.array(columns[k], t) for k, t in ((0, np.int64), (5, bool), (6, float), (7, float))
        )
        return Measured(ids, asked, seen, f, sigma, saturated, rig_s, wall_s)

    def raw(self) -> list[dict[str, Any]]:
        """What the detector itself said of each measurement, in the order of their making; empty where nothing."""
        with explained(self.folder):
            rows = self._db.execute("SELECT raw FROM measurements ORDER BY wall_s, rowid").fetchall()
        return [json.loads(text) if text else {} for (text,) in rows]

    def steps(self) -> dict[str, NDArray]:
        """Columns of the step log, ordered by chain and step; `proposed` (N, 6) is NaN for measured ones."""
        with explained(self.folder):
            rows = self._db.execute(
                f"SELECT {', '.join(STEP_COLUMNS)}, proposed FROM steps ORDER BY chain, step"
            ).fetchall()
        *columns, proposed = zip(*rows) if rows else [()] * (len(STEP_COLUMNS) + 1)
        types = (np.int64, np.int64, np.int8, np.int64, bool, float, np.int64, float)
        out: dict[str, NDArray] = {n: np.array(c, dtype=t) for n, c, t in zip(STEP_COLUMNS, columns, types)}
        nothing = np.full(6, np.nan).tobytes()
        out["proposed"] = np.frombuffer(b"".join(p or nothing for p in proposed)).reshape(-1, 6)
        return out

    def events(self) -> list[tuple[float, str, str]]:
        with explained(self.folder):
            return self._db.execute("SELECT wall_s, kind, text FROM events ORDER BY rowid").fetchall()

    def wall_s(self) -> float:
        """Seconds the run has been worked on, over all its sessions."""
        return self._wall_before + time.monotonic() - self._began

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        try:
            self.commit()
        finally:
            self._db.close()
            if self._lock is not None:
                os.close(self._lock)
                self._lock = None

    def discard(self) -> None:
        """Of a run just created: no folder of it is left. One that was there before is closed and stays."""
        self.close()
        if self._made is not None:
            with explained(self.folder):
                remove(self.folder, self._made)

    def __enter__(self) -> "Store":
        return self

    def __exit__(self, *exc) -> None:
        self.close()
