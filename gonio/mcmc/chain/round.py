"""A block of steps drawn together: what was proposed, what came back, how far it is judged."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array


@dataclass
class Round:
    """N = block x chains proposals, those of one step of all chains side by side, and after them others that are no
    chain's; M of them are to be measured.

    u (n, N) coordinates (None in the pilot), wi, wo (N, 3), log_j (N,) log Jacobian, kind (N,), log_coin (block,
    chains) logs of the uniforms that decide acceptance; where (M,) positions of the measured ones, whose ids are
    first_id, first_id + 1, …; f, sigma (M, C) as told so far, told (M,); log_s (N,) what the surrogate's stage already
    accounted for; log_rest (N,) the part of the target that was frozen when the block was designed.
    """

    u: Array | None
    wi: Array
    wo: Array
    log_j: Array
    kind: NDArray[np.int8]
    log_coin: Array
    where: NDArray[np.int64]
    first_id: int
    block: int
    f: Array
    sigma: Array
    told: NDArray[np.bool_]
    log_s: Array | None = None
    log_rest: Array | None = None
    settled: int = 0
    unanswered: int = 0

    @classmethod
    def of(
        cls,
        u,
        wi,
        wo,
        log_j,
        kind,
        log_coin,
        alive,
        *,
        channels: int,
        first_id: int,
        block: int,
        log_s=None,
        log_rest=None,
    ) -> "Round":
        """A round whose proposals `alive` (N,) wait for a measurement; the others are settled free of charge."""
        where = alive.nonzero()[0]
        m = len(where)
        f, sigma, told = np.empty((m, channels)), np.zeros((m, channels)), np.zeros(m, bool)
        return cls(u, wi, wo, log_j, kind, log_coin, where, first_id, block, f, sigma, told, log_s, log_rest, 0, m)

    def wanted(self) -> tuple[NDArray[np.int64], Array, Array]:
        """ids, wi, wo not answered yet, in drawn order."""
        if self.unanswered < len(self.where):
            left = (~self.told).nonzero()[0]
            at = self.where[left]
            return self.first_id + left, self.wi[at], self.wo[at]
        ids = np.arange(self.first_id, self.first_id + len(self.where))
        if len(self.where) == len(self.wi):
            return ids, self.wi, self.wo
        return ids, self.wi[self.where], self.wo[self.where]

    def answer(self, ids: NDArray[np.int64], f: Array, sigma: Array | None) -> None:
        """Fill in measurements. Raises KeyError for an id that was not asked for or was told before."""
        k = ids - self.first_id
        if k.min() < 0 or k.max() >= len(self.where):
            raise KeyError(f"measurements {ids} were not asked for")
        if self.unanswered < len(self.where) and self.told[k].any():
            raise KeyError(f"measurements {ids[self.told[k]]} were told before")
        self.f[k] = f
        if sigma is not None:
            self.sigma[k] = sigma
        self.told[k] = True
        self.unanswered -= len(ids)

    def ready(self, chains: int) -> int:
        """Steps of the block for which all chains have their answers."""
        if self.unanswered == 0:
            return self.block
        return min(int(self.where[np.argmin(self.told)]) // chains, self.block)

    def ids(self) -> NDArray[np.int64]:
        """(N,) measurement of each proposal, -1 where free."""
        ids = np.full(len(self.wi), -1, np.int64)
        ids[self.where] = np.arange(self.first_id, self.first_id + len(self.where))
        return ids

    def values(self, target) -> tuple[Array, Array, NDArray[np.int64]]:
        """log target (N,), f (N, C) and id (N,) of every proposal; -inf where outside the support or not measured."""
        n, ids = len(self.wi), self.ids()
        if self.log_rest is None and len(self.where) == n and self.unanswered == 0 and np.isfinite(self.f.sum()):
            return target.log_prob(self.f, self.wi, self.wo), self.f, ids
        good = (self.told & np.isfinite(self.f).all(1)).nonzero()[0]
        at = self.where[good]
        log_p, f = np.full(n, -np.inf), np.zeros((n, self.f.shape[1]))
        f[at] = self.f[good]
        frozen = () if self.log_rest is None else (self.log_rest[at],)
        log_p[at] = target.log_prob(f[at], self.wi[at], self.wo[at], *frozen)
        return log_p, f, ids

    def state(self) -> dict[str, Any]:
        return {k.name: _copy(getattr(self, k.name)) for k in fields(self)}

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> "Round":
        return cls(**{k: _copy(v) for k, v in state.items()})


def _copy(value: Any) -> Any:
    return value.copy() if isinstance(value, np.ndarray) else value
