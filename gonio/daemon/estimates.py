"""Effective samples and error estimate of a run under way, worked out beside it: by another process, of low priority,
that reads the run's file. Nothing it does, slowness included, reaches the rig.
"""

import json
import math
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from gonio.daemon.status_board import StatusBoard

FIRST, GROWTH = 100, 1.25  # measurements; between two estimates
PAUSE_S = 1.0


class Estimator:
    """Puts `estimate: {measured, ess, energy_error}` on the board's job, on a growing schedule and once at the end.

    Of a run that is done it is None, and `estimating` true, until the last one is there, which stays: what is shown
    after the end is final.
    """

    def __init__(self, folder: Path, board: StatusBoard):
        self._folder, self._board = folder, board
        self._job = board.state()["job"]["id"]
        self._closed, self._done, self._lock = threading.Event(), False, threading.Lock()
        self.thread = threading.Thread(target=self._loop, name="estimates", daemon=True)
        self.thread.start()

    def close(self, *, done: bool) -> None:
        """The run has ended; only one that is done is worth a last look."""
        with self._lock:
            self._done = done
            self._closed.set()
            if done and self._measured() >= FIRST:
                self._board.job_of(self._job, estimate=None, estimating=True)

    def _measured(self) -> int:
        job = self._board.state()["job"] or {}
        return int((job.get("progress") or {}).get("measured", 0)) if job.get("id") == self._job else 0

    def _loop(self) -> None:
        due = FIRST
        over = False
        while not over:
            over = self._closed.wait(PAUSE_S)
            job = self._board.state()["job"] or {}
            if job.get("id") != self._job:
                return
            measured = (job.get("progress") or {}).get("measured", 0)
            if (measured >= due and not over) or (over and self._done and measured >= FIRST):
                due = int(GROWTH * measured) + 1
                found = self._ask()
                with self._lock:
                    if over:
                        self._board.job_of(
                            self._job, estimate=found and {"measured": measured, **found}, estimating=False
                        )
                    elif found is not None and not self._closed.is_set():  # asked before the end, told after it: old
                        self._board.job_of(self._job, estimate={"measured": measured, **found})

    def _ask(self) -> dict[str, Any] | None:
        env = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "gonio.daemon.estimates", str(self._folder)]
        try:
            done = subprocess.run(command, capture_output=True, env=env, text=True, timeout=300)
            return json.loads(done.stdout) if done.returncode == 0 else None
        except (OSError, ValueError, subprocess.TimeoutExpired):
            return None


def estimate(folder: Path) -> dict[str, Any]:
    """ess and energy_error of a run folder; None for what cannot be said yet."""
    from gonio.reconstruct.errors import ReconstructionError
    from gonio.run.record.config import read_config
    from gonio.run.record.store import Store
    from gonio.run.stop_rules import GoodEnough

    with Store.open(folder, write=False) as store:
        so_far = GoodEnough(read_config(folder).material, store)
        ess = so_far.effective_samples()
        try:
            error = so_far.energy_error()
        except ReconstructionError:
            error = math.nan
    return {
        "ess": round(ess, 1) if math.isfinite(ess) else None,
        "energy_error": round(error, 5) if math.isfinite(error) else None,
    }


if __name__ == "__main__":
    os.nice(10)
    print(json.dumps(estimate(Path(sys.argv[1]))))
