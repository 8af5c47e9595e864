"""The daemon's jobs: a run, or one thing by hand. Each `prepare` finds errors before the rig is touched."""

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from gonio.acquire import Progress
from gonio.config import Material
from gonio.config.scan import Scan
from gonio.daemon.control import Control, Work
from gonio.daemon.estimates import Estimator
from gonio.daemon.rig_owner import RigOwner
from gonio.daemon.rig_view import RigView
from gonio.run.start import Run, resume, start

SHOWN_S = 0.05  # between two looks at the progress


def acquire(
    control: Control, material: Material, folder: Path | None, scan: Scan | None = None
) -> tuple[Work, dict[str, Any]]:
    """A new run, of a list of directions where there is one. Raises ConfigError, StoreError, BrdfFileError."""
    return driven(control, start(material, control.config, folder, scan=scan))


def go_on_with(control: Control, folder: Path, overrides: tuple[str, ...] = ()) -> tuple[Work, dict[str, Any]]:
    """An interrupted run. Raises ConfigError, StoreError."""
    return driven(control, resume(folder, overrides))


def by_hand(act: Callable[..., dict[str, Any]], *args: Any) -> tuple[Work, dict[str, Any]]:
    """home, park, jog, measure of gonio.daemon.manual."""
    return (lambda owner: act(owner, *args)), {}


def driven(control: Control, run: Run) -> tuple[Work, dict[str, Any]]:
    """The job of a run, and what is to be said of it."""
    material = run.config.material
    folder = run.store.folder.resolve()
    board = control.board
    shown = 0.0
    last: Progress | None = None

    def show(p: Progress) -> None:
        board.job(progress=progress_row(p))

    def watch(p: Progress) -> None:
        nonlocal shown, last
        last = p
        if (now := time.monotonic()) - shown > SHOWN_S:
            shown = now
            show(p)
        control.safe_point()

    def work(owner: RigOwner) -> dict[str, Any]:
        estimator = Estimator(folder, board)
        done = False
        try:
            with run.nothing_left_behind():
                rig = owner.for_run(material, run.truth)
            view: Any = RigView(rig, board, lambda: control.stopped)
            reason = run(watch=watch, interrupted=lambda: control.stopped, rig=view)
            done = True
            return {"reason": reason}
        finally:
            if last is not None:
                show(last)
            run.close()
            estimator.close(done=done)

    about = {"material": material.name, "run": str(folder), "truth": run.store.get("provenance", {}).get("truth", "")}
    return work, about


def progress_row(p: Progress) -> dict[str, Any]:
    """The figures of a run under way; seconds are rig seconds unless named wall."""
    done = p.measured - p.measured_before
    eta = p.eta_s()
    left = None if p.budget is None or not p.measured else (p.budget - p.measured) * p.rig_s / p.measured
    return {
        "measured": p.measured,
        "budget": p.budget,
        "free": p.free,
        "steps": p.steps,
        "acceptance": round(p.acceptance, 4),
        "rig_s": round(p.rig_s, 3),
        "rig_left_s": None if left is None else round(left, 1),
        "wall_s": round(time.monotonic() - p.began, 2),
        "wall_left_s": None if eta is None else round(eta, 1),
        "per_s": round(done / max(time.monotonic() - p.began, 1e-6), 2),
        "energy_error": None
        if p.energy_error is None or not math.isfinite(p.energy_error)
        else round(p.energy_error, 5),
    }
