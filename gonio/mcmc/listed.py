"""Directions given by hand, once or again and again, in place of a chain."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.mcmc.chain.steps import StepLog, Steps
from gonio.mcmc.proposals import LISTED
from gonio.mcmc.sampler import Batch


class Listed:
    """Implements `AskTell`: all pairs wi, wo (N, 3), then all of them again, without end; the budget ends it.

    Measurement k of pass r has the id r N + k. A pass is handed out as a whole, so that the rig may order it, and the
    next begins when all of it was told: what changes with time is seen between the passes.
    """

    plan: Any = None  # it has none, and learns nothing

    def __init__(self, wi: Array, wo: Array):
        self.wi, self.wo = wi, wo
        self._pass = 0
        self._told = np.zeros(len(wi), bool)
        self._log = StepLog(1)
        self.unmeasured_in_a_row = 0

    def ask(self) -> Batch:
        left = np.flatnonzero(~self._told)
        return Batch(self._pass * len(self.wi) + left, self.wi[left], self.wo[left])

    def tell(self, ids: NDArray, f: Array, sigma: Array | None = None) -> None:
        """Raises KeyError for an id not asked for."""
        ids, f = np.asarray(ids, np.int64), np.asarray(f, float)
        k = ids - self._pass * len(self.wi)
        if ((k < 0) | (k >= len(self.wi))).any() or self._told[k].any():
            raise KeyError(f"measurements {ids} were not asked for")
        self._told[k] = True
        good = np.flatnonzero(np.isfinite(f).all(1))
        self.unmeasured_in_a_row = len(ids) - 1 - int(good[-1]) if len(good) else self.unmeasured_in_a_row + len(ids)
        nothing = np.full(len(ids), np.nan)
        kinds = np.full(len(ids), LISTED, np.int8)
        self._log.add_listed(self._pass, ids, kinds, nothing, self.wi[k], self.wo[k])
        if self._told.all():
            self._pass += 1
            self._told[:] = False

    def take_steps(self) -> Steps:
        """A row for each measurement: no step of a chain; in place of the chain, the pass."""
        return self._log.take()
