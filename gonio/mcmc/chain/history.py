"""All that was proposed and measured: what an adaptive proposal may learn from."""

import numpy as np

from gonio.geometry import Array


class History:
    """Columns id (N,), wi, wo (N, 3), f, sigma (N, C), log_q (N,); grows by doubling.

    log_q is the log density of the draw (solid angles); NaN where the draw has none (local moves, whose density hangs
    on where the chain was).
    """

    def __init__(self, channels: int):
        self.channels, self.count = channels, 0
        self._columns = [np.empty((0, *shape)) for shape in ((), (3,), (3,), (channels,), (channels,), ())]

    def add(self, ids: Array, wi: Array, wo: Array, f: Array, sigma: Array, log_q: Array) -> None:
        n = self.count + len(ids)
        if n > len(self._columns[0]):
            size = max(256, 2 * n)
            self._columns = [
                np.concatenate([c[: self.count], np.empty((size - self.count, *c.shape[1:]))]) for c in self._columns
            ]
        for column, new in zip(self._columns, (ids, wi, wo, f, sigma, log_q)):
            column[self.count : n] = new
        self.count = n

    def without(self, ids: Array) -> dict[str, Array]:
        """wi, wo, f, sigma, log_q by name, of all but `ids`.

        Leaving out the points at which chains now sit keeps an adaptive independence chain exact at every step
        (Holden, Hauge & Holden 2009, Adaptive independent Metropolis-Hastings).
        """
        i, *rest = (c[: self.count] for c in self._columns)
        keep = ~np.isin(i, ids)
        return {k: c[keep] for k, c in zip(("wi", "wo", "f", "sigma", "log_q"), rest)}

    def state(self) -> dict[str, Array]:
        return {str(k): c[: self.count].copy() for k, c in enumerate(self._columns)}

    def restore(self, state: dict[str, Array]) -> None:
        self._columns = [np.array(state[str(k)]) for k in range(len(self._columns))]
        self.count = len(self._columns[0])
