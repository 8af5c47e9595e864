"""The loop: ask -> plan -> move -> measure -> store -> tell. No step reaches back."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from gonio.config.material import Material
from gonio.mcmc import Batch
from gonio.mcmc.ask_tell import AskTell
from gonio.rig.devices import Rig, Visited
from gonio.rig.errors import DeviceFault
from gonio.run.record.replay import replay
from gonio.run.record.store import Store


@dataclass
class Progress:
    """What a watcher is shown while a run goes on."""

    measured: int = 0
    free: int = 0
    steps: int = 0
    accepted: int = 0
    rig_s: float = 0.0
    began: float = field(default_factory=time.monotonic)
    measured_before: int = 0
    budget: int | None = None
    energy_error: float | None = None
    seen: Visited | None = None  # the measurements just made

    @property
    def acceptance(self) -> float:
        return self.accepted / self.steps if self.steps else 0.0

    def eta_s(self) -> float | None:
        """Seconds left to the measurement budget at the pace of this session; None where there is no telling."""
        done = self.measured - self.measured_before
        if self.budget is None or done == 0:
            return None
        return (self.budget - self.measured) * (time.monotonic() - self.began) / done


class Interrupted(Exception):
    """The operator asked to stop; all that was measured is stored, and `gonio resume` goes on."""

    exit_code = 130


def acquire(
    sampler: AskTell,
    rig: Rig,
    store: Store,
    material: Material,
    *,
    watch: Callable[[Progress], None] = lambda progress: None,
    interrupted: Callable[[], bool] = lambda: False,
    good_enough: Callable[[Progress], str | None] = lambda progress: None,
) -> str:
    """Drive the rig until the budget is spent or the result is good; the reason why it ended.

    A store that holds measurements already is continued: the chain is told them again first. Raises Interrupted
    (after the measurement under way, all stored), DeviceFault, SafetyStop, StoreError, mcmc.NoSupport.
    """
    progress = Progress(budget=material.budget.measurements)
    known, steps = replay(sampler, store)
    progress.measured = progress.measured_before = len(known.id)
    progress.rig_s = float(known.rig_s.sum())
    _count_steps(progress, steps)
    while True:
        if (reason := _spent(material, progress) or good_enough(progress)) is not None:
            return reason
        if interrupted():  # a rig that was stopped must not be asked to move again
            raise Interrupted
        batch = _within_budget(sampler.ask(), material.budget.measurements, progress.measured)
        asked = np.concatenate([batch.wi, batch.wo], 1)
        for seen in rig.visit(batch.wi, batch.wo, batch.ids):
            _store(store, rig, seen, asked[np.searchsorted(batch.ids, seen.ids)])
            sampler.tell(seen.ids, seen.f, seen.sigma)
            _count(progress, store, sampler, seen)
            watch(progress)
            if sampler.unmeasured_in_a_row >= material.stop.unmeasured:
                n = sampler.unmeasured_in_a_row
                raise DeviceFault(
                    "detector",
                    f"{n} readings in a row could not be used",
                    "check light, cables and range, then `gonio resume`",
                )
            if interrupted():
                raise Interrupted
            if (reason := _spent(material, progress) or good_enough(progress)) is not None:
                return reason  # in the middle of a block too: late ones are as large as all before them


def _within_budget(batch: Batch, budget: int | None, measured: int) -> Batch:
    """The first measurements of a batch in drawn order, so that those made settle their steps."""
    left = len(batch.ids) if budget is None else budget - measured
    return Batch(batch.ids[:left], batch.wi[:left], batch.wo[:left])


def _store(store: Store, rig: Rig, seen: Visited, asked) -> None:
    store.keep(rig.state())
    directions = np.concatenate([seen.wi, seen.wo], 1)
    store.add(seen.ids, asked, directions, seen.f, seen.sigma, seen.saturated, seen.raw, seen.rig_s)


def _count(progress: Progress, store: Store, sampler: AskTell, seen: Visited) -> None:
    steps = sampler.take_steps()
    store.add_steps(steps)
    _count_steps(progress, steps)
    progress.seen = seen
    progress.measured += len(seen.ids)
    progress.rig_s += float(seen.rig_s.sum())


def _count_steps(progress: Progress, steps) -> None:
    of_chains = steps.step >= 0
    progress.steps += int(of_chains.sum())
    progress.accepted += int(steps.accepted.sum())
    progress.free += int((steps.id[of_chains] < 0).sum())


def _spent(material: Material, progress: Progress) -> str | None:
    budget = material.budget
    if budget.measurements is not None and progress.measured >= budget.measurements:
        return f"budget of {budget.measurements} measurements"
    if budget.rig_hours is not None and progress.rig_s >= 3600 * budget.rig_hours:
        return f"budget of {budget.rig_hours:g} rig hours"
    return None
