"""The step log: one row per step of every chain, measured or free."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.mcmc.proposals import LOCAL


@dataclass(frozen=True)
class Steps:
    """Rows in the order chains settled them; step counts from 0 in each chain.

    Measurements that are no step have a step below 0, and in place of the chain the block they belong to: 0 is the
    pilot, k + 1 the block in which chains took step k.

    kind      index into `gonio.mcmc.proposals.KINDS`
    id        the measurement, -1 for a proposal settled free of charge
    accepted  whether the chain moved there
    log_q     log density of the draw in solid angles of (wi, wo) (isotropic: up to a constant); NaN for local moves
              and for what fills holes
    state     measurement the chain is at after the step, -1 before it has found the support
    wi, wo    (N, 3) what was proposed
    log_p     log of the target there (unnormalised, as it was at this step): f cos / exp(log_p) is the importance
              weight that turns an average over states into one over f cos
    """

    chain: NDArray[np.int32]
    step: NDArray[np.int64]
    kind: NDArray[np.int8]
    id: NDArray[np.int64]
    accepted: NDArray[np.bool_]
    log_q: Array
    state: NDArray[np.int64]
    log_p: Array
    wi: Array
    wo: Array

    def __len__(self) -> int:
        return len(self.step)

    @classmethod
    def concatenate(cls, parts: list["Steps"]) -> "Steps":
        """All rows, in the order of the parts."""
        if not parts:
            return cls.empty()
        return cls(**{k.name: np.concatenate([getattr(p, k.name) for p in parts]) for k in fields(cls)})

    @classmethod
    def empty(cls) -> "Steps":
        chain, step, kind, ids, accepted, log_q, state, log_p = (
            np.empty(0, t) for t in (np.int32, np.int64, np.int8, np.int64, bool, float, np.int64, float)
        )
        return cls(chain, step, kind, ids, accepted, log_q, state, log_p, np.empty((0, 3)), np.empty((0, 3)))


class StepLog:
    """Collects columns of steps, all chains at once, and hands them out as `Steps`."""

    def __init__(self, chains: int):
        self.index = np.arange(chains, dtype=np.int32)
        self._columns: list[tuple] = []
        self._parts: list[Steps] = []

    def add(self, step: int, kind, id, accepted, log_j, state, log_p, wi, wo) -> None:
        """One column: a step of every chain; the arrays become the log's own. log_j = -log_q."""
        self._columns.append((step, kind, id, accepted, log_j, state, log_p, wi, wo))

    def add_others(self, block: int, ids: NDArray[np.int64], kind, log_q: Array, log_p: Array, wi, wo) -> None:
        """Measurements of a block that are no step of a chain."""
        n = len(ids)
        of_block, none, no = np.full(n, block, np.int32), np.full(n, -1, np.int64), np.zeros(n, bool)
        self._parts += [
            self._of_columns(),
            Steps(of_block, np.arange(-n, 0), kind, ids, no, log_q, none, log_p, wi, wo),
        ]

    def add_listed(self, block: int, ids: NDArray[np.int64], kind, nothing: Array, wi, wo) -> None:
        """Measurements that nobody drew: rows counted by their ids, so that they may come one by one."""
        n = len(ids)
        of_block, none, no = np.full(n, block, np.int32), np.full(n, -1, np.int64), np.zeros(n, bool)
        self._parts += [self._of_columns(), Steps(of_block, -1 - ids, kind, ids, no, nothing, none, nothing, wi, wo)]

    def take(self) -> Steps:
        """All rows since the last call."""
        parts, self._parts = self._parts, []
        return Steps.concatenate([*parts, self._of_columns()]) if parts else self._of_columns()

    def _of_columns(self) -> Steps:
        columns, self._columns = self._columns, []
        if not columns:
            return Steps.empty()
        steps, *rest = zip(*columns)
        kind, ids, accepted, log_j, state, log_p, wi, wo = (np.concatenate(c) for c in rest)
        step = np.repeat(np.array(steps, np.int64), len(self.index))
        log_q = np.where(kind == LOCAL, np.nan, -log_j)
        log_p = np.where(state < 0, np.nan, log_p)
        chain = np.tile(self.index, len(steps))
        return Steps(chain, step, kind, ids, accepted, log_q, state, log_p, wi, wo)
