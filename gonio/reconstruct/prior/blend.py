"""The base under a reconstruction: the fitted lobes, and beside them, of few samples, what materials look like.

    ln (b + e) = (1 - w) ln (b_lobes + e) + w ln (b_prior + e)
    w / (1 - w) = WORTH / N  min(1, E_lobes / E_prior)^2

The prior counts as so many samples, and as fewer where it says samples that were held out worse than lobes do; E is
the mean |ln| at those. Two guesses of different kinds err in different places, and their mean errs less than either
(docs/reconstruction.md has the table).
"""

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.prior.materials import EPS, NODES, chart, shipped
from gonio.reconstruct.splines.frame import PairAngles
from gonio.reconstruct.splines.robust_base import Angles, RobustBase
from gonio.reconstruct.tables.lookup import Lookup

WORTH = 25
LEAST = 0.05  # odds up to which the lobes stand alone
FOLDS = 5
LOWEST = 0.01  # cosine below which the table is not trusted


class Blend:
    """g (N, C) of angles. table (n, C), s (C,): what `Materials.table_of` says; floor (C,): e."""

    def __init__(self, lobes: RobustBase, table: Array, s: Array, weight: float, floor: Array):
        self.lobes, self.table, self.s, self.weight, self.floor = lobes, table, s, weight, floor
        self.channels = lobes.channels
        self._prior = Lookup(table.reshape(*NODES, -1), (False,) * 3, (1, 1, 1))

    def __call__(self, a: Angles) -> Array:
        """(N, C)."""
        # between nodes above and below the horizon the table does not fall as the cosines do: there it has less say
        fades = np.minimum(a.cos_o / LOWEST, 1) / np.maximum(a.cos_i, LOWEST)
        prior = np.maximum(np.exp(self._prior(chart(a))) - EPS * self.s, 0) * fades[:, None]
        lobes = np.log(self.lobes(a) + self.floor)
        return np.exp(lobes + self.weight * (np.log(prior + self.floor) - lobes)) - self.floor

    @classmethod
    def over(
        cls, lobes: RobustBase, a: PairAngles, g: Array, sigma: Array, floor: Array, weight: float | None = None
    ) -> "RobustBase | Blend":
        """Lobes and prior of samples g, sigma (N, C) at `a`; the lobes alone of many samples, or under a grain.

        weight: w, None = as above. Raises PriorError."""
        odds = WORTH / len(g)
        if odds <= LEAST or not isinstance(a, Angles) or weight == 0:
            return lobes
        if weight is None:
            odds *= min(1.0, _lobes_over_prior(a, g, sigma, floor)) ** 2
            weight = odds / (1 + odds)
        return cls(lobes, *shipped().table_of(a, g, sigma), weight, floor)

    def to_arrays(self) -> dict[str, Array]:
        own = {"prior": self.table.astype(np.float32), "prior_s": self.s, "prior_weight": np.array(self.weight)}
        return self.lobes.to_arrays() | own | {"prior_floor": self.floor}


Base = RobustBase | Blend


def _lobes_over_prior(a: Angles, g: Array, sigma: Array, floor: Array) -> float:
    """Mean |ln error| of lobes over that of the prior, of samples held out from both."""
    rng = np.random.default_rng(0)
    fold = rng.permutation(len(g)) % FOLDS
    missed = np.zeros(2)
    for out in (fold == k for k in range(FOLDS)):
        lobes = RobustBase.fit(a.at(~out), g[~out], floor, rng, sigma[~out])
        prior = Blend(lobes, *shipped().table_of(a.at(~out), g[~out], sigma[~out]), 1.0, floor)
        truth = np.log(np.maximum(g[out], 0) + floor)
        missed += [np.abs(np.log(base(a.at(out)) + floor) - truth).sum() for base in (lobes, prior)]
    return float(missed[0] / max(missed[1], 1e-300))


def base_from(d: dict[str, Array]) -> Base:
    """The base that `to_arrays` wrote."""
    lobes = RobustBase(d["weights"])
    if "prior" not in d:
        return lobes
    return Blend(lobes, d["prior"].astype(float), d["prior_s"], float(d["prior_weight"]), d["prior_floor"])
