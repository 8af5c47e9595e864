"""The board: what the control thread writes up and watchers read. Nobody who reads it can hold up the rig.

Watchers ask for what is new since a number they were given before; one that is slow, hangs or dies is not known here.
"""

import threading
import time
from collections import deque
from typing import Any

import numpy as np

from gonio.geometry import Array, to_angles

Row = tuple[float | None, ...]
KEPT = 20_000  # samples that a late watcher still gets


class StatusBoard:
    """State and samples of one rig; safe from any thread. `version` counts changes."""

    def __init__(self, rig: dict[str, Any]):
        self._lock = threading.Lock()
        self._state: dict[str, Any] = {"rig": rig, "state": "idle", "job": None, "pose_deg": None, "devices": []}
        self._samples: deque[Row] = deque(maxlen=KEPT)
        self._count = 0
        self._job = 0
        self.version = 0

    def write(self, **changes: Any) -> None:
        """Set keys of the state."""
        with self._lock:
            self._state.update(changes)
            self.version += 1

    def job(self, **changes: Any) -> None:
        """Set keys of the job's entry."""
        with self._lock:
            self._state["job"] = {**(self._state["job"] or {}), **changes}
            self.version += 1

    def job_of(self, number: int, **changes: Any) -> None:
        """As `job`, unless another job is on now."""
        with self._lock:
            if number == self._job:
                self._state["job"] = {**self._state["job"], **changes}
                self.version += 1

    def begin(self, job: dict[str, Any]) -> int:
        """A new job: samples of the one before are wiped; its number."""
        with self._lock:
            self._job += 1
            self._samples.clear()
            self._count = 0
            entry = {"id": self._job, "began": time.time(), "ended": None, "code": None, "message": "", **job}
            self._state.update(job=entry, state="running")
            self.version += 1
            return self._job

    def add(self, wi: Array, wo: Array, f: Array, saturated: Array) -> None:
        """Measurements (M,): drawn with the light at azimuth 180 degrees, coloured by the mean of f over channels.

        A row is theta_i, theta_o, phi_o - phi_i (rad), log10 f (None where there was no light to speak of), saturated.
        """
        (theta_i, phi_i), (theta_o, phi_o) = to_angles(wi), to_angles(wo)
        turn = np.mod(phi_o - phi_i, 2 * np.pi)
        mean = f.mean(1)
        usable = np.isfinite(mean) & (mean > 0)
        log_f = np.log10(np.where(usable, mean, 1.0))
        columns = [np.round(c, 4).tolist() for c in (theta_i, theta_o, turn, log_f)]
        rows = [
            (a, b, c, v if good else None, int(s)) for a, b, c, v, good, s in zip(*columns, usable, saturated.tolist())
        ]
        with self._lock:
            self._samples.extend(rows)
            self._count += len(rows)
            self.version += 1

    def state(self) -> dict[str, Any]:
        """A copy: rig, state, job, pose_deg, devices."""
        with self._lock:
            return {**self._state, "job": self._state["job"] and dict(self._state["job"]), "version": self.version}

    def samples(self, job: int, since: int, most: int = 4000) -> tuple[int, int, list[Row]]:
        """(job, count, rows) after the first `since` of job number `job`; all of them where another job is on now.

        Rows no longer kept, or beyond `most`, are left out, the oldest first.
        """
        with self._lock:
            new = self._count - (since if job == self._job else 0)
            new = max(0, min(new, most, len(self._samples)))
            rows = [self._samples[k] for k in range(-new, 0)] if new else []
            return self._job, self._count, rows
