"""The base under a reconstruction: the fitted lobes, and beside them, of few samples, what materials look like.

    ln (b + e) = (1 - w) ln (b_lobes + e) + w ln (b_prior + e),   w = WORTH / (WORTH + N)

The prior counts as so many samples. Two guesses of different kinds err in different places, and their mean errs less
than either (docs/reconstruction.md has the table).
"""

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.prior.materials import EPS, NODES, chart, shipped
from gonio.reconstruct.splines.frame import PairAngles
from gonio.reconstruct.splines.robust_base import Angles, RobustBase
from gonio.reconstruct.tables.lookup import Lookup

WORTH = 25
LEAST = 0.05  # weight below which the lobes stand alone


class Blend:
    """g (N, C) of angles. table (n, C), s (C,): what `Materials.table_of` says; floor (C,): e."""

    def __init__(self, lobes: RobustBase, table: Array, s: Array, weight: float, floor: Array):
        self.lobes, self.table, self.s, self.weight, self.floor = lobes, table, s, weight, floor
        self.channels = lobes.channels
        self._prior = Lookup(table.reshape(*NODES, -1), (False,) * 3, (1, 1, 1))

    def __call__(self, a: Angles) -> Array:
        """(N, C)."""
        prior = np.maximum(np.exp(self._prior(chart(a))) - EPS * self.s, 0) / a.cos_i[:, None]
        lobes = np.log(self.lobes(a) + self.floor)
        return np.exp(lobes + self.weight * (np.log(prior + self.floor) - lobes)) - self.floor

    @classmethod
    def over(cls, lobes: RobustBase, a: PairAngles, g: Array, sigma: Array, floor: Array) -> "RobustBase | Blend":
        """Lobes and prior of samples g, sigma (N, C) at `a`; the lobes alone of many samples, or under a grain."""
        weight = WORTH / (WORTH + len(g))
        if weight < LEAST or not isinstance(a, Angles):
            return lobes
        return cls(lobes, *shipped().table_of(a, g, sigma), weight, floor)

    def to_arrays(self) -> dict[str, Array]:
        own = {"prior": self.table.astype(np.float32), "prior_s": self.s, "prior_weight": np.array(self.weight)}
        return self.lobes.to_arrays() | own | {"prior_floor": self.floor}


Base = RobustBase | Blend


def base_from(d: dict[str, Array]) -> Base:
    """The base that `to_arrays` wrote."""
    lobes = RobustBase(d["weights"])
    if "prior" not in d:
        return lobes
    return Blend(lobes, d["prior"].astype(float), d["prior_s"], float(d["prior_weight"]), d["prior_floor"])
