"""A rig that a way of measuring looks through: what was read, and the rig seconds it took."""

from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.brdf import Brdf
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.reconstruct import Samples
from gonio.run.open_rig import open_rig

# the motion of a rig that knows no better: one pose for a pair, in the order asked for, ranges found by trial
STRAIGHT = PlanConfig(branches=False, tour=False, free_azimuth=False, predict_range=False)

READ = ("wi", "wo", "f", "sigma", "saturated")


class Session:
    """One sample on one simulated rig. material is its name, so that a peer that learnt from materials can leave out
    this one and its kin; plan: how the rig moves; notes: what a peer wants to find again. Isotropic samples."""

    def __init__(self, material: str, truth: Brdf, rig: RigConfig, seed: int, plan: PlanConfig):
        self.material, self.channels, self.seed = material, truth.channels, seed
        self._rig = open_rig(rig, truth, seed, plan=plan, isotropic=True)
        self._parts: list[Samples] = []
        self.rig_s, self.measured = 0.0, 0
        self.notes: dict[str, Any] = {}

    def reachable(self, wi: Array, wo: Array) -> Array:
        """(N,) bool."""
        return self._rig.reachable(wi, wo)

    def __call__(self, wi: Array, wo: Array, surrogate: Callable | None = None) -> Samples:
        """What the rig reads at wi, wo (N, 3), as asked for; readings that failed are NaN.

        surrogate(wi, wo) -> (N, C): what readings will be about. The pairs are one tour, if the plan makes tours.
        """
        self._rig.surrogate = surrogate
        seen = list(self._rig.visit(wi, wo, np.arange(len(wi))))
        ids = np.concatenate([v.ids for v in seen]) if seen else np.zeros(0, int)
        back = np.argsort(ids)
        wi, wo, f, sigma = (np.concatenate([getattr(v, k) for v in seen])[back] for k in ("wi", "wo", "f", "sigma"))
        saturated = np.concatenate([v.saturated for v in seen])[back]
        self.rig_s += float(sum(v.rig_s.sum() for v in seen))
        self.measured += len(ids)
        self._parts.append(Samples.of(wi, wo, f, sigma, saturated))
        return self._parts[-1]

    @property
    def samples(self) -> Samples:
        """All that was read so far and is a number."""
        joined = {
            k: np.concatenate([getattr(p, k) for p in self._parts]) for k in ("wi", "wo", "f", "sigma", "saturated")
        }
        good = np.isfinite(joined["f"]).all(1)
        return Samples.of(**{k: v[good] for k, v in joined.items()})


def visible(session: Session, wi: Array, wo: Array) -> Array:
    """(N,) bool: above the horizon, and the rig can go there."""
    return (np.minimum(wi[:, 2], wo[:, 2]) > 1e-3) & session.reachable(wi, wo)
