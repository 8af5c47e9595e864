"""Delayed acceptance (Christen & Fox 2005): a surrogate settles hopeless proposals before the rig moves.

Exact with any surrogate that is positive wherever the target is: the second stage judges the ratio of the two. The
surrogate is the running reconstruction, refitted on the sampler's growing schedule without the chains' present points.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.geometry import Array
from gonio.mcmc.target import Target

FLOOR = 0.02  # of the mean of f so far, added to the surrogate: what it wrongly holds for black is still visited


class Delayed:
    """The proposal `inner`, screened by fit_surrogate(wi, wo, f) -> Brdf once 50 measurements are there."""

    learns = True

    def __init__(self, inner, fit_surrogate: Callable | None):
        self.kernels = [(inner, 1)]
        self.fit_surrogate = fit_surrogate
        self.screen: Callable[[Array, Array], Array] | None = None
        self._data: tuple[Array, Array, Array] | None = None

    def learn(self, target: Target, wi: Array, wo: Array, f: Array, log_q: Array) -> None:
        if self.fit_surrogate is None or len(wi) < 50 or not (f > 0).any():
            return
        self._data = (wi.copy(), wo.copy(), f.copy())
        self._fit(*self._data)

    def _fit(self, wi: Array, wo: Array, f: Array) -> None:
        assert self.fit_surrogate is not None  # nothing learnt or restored without one
        brdf = self.fit_surrogate(wi, wo, f)
        floor = FLOOR * np.median(np.maximum(f, 0), axis=0) + 1e-12
        self.screen = None if brdf is None else lambda a, b: brdf.eval(a, b) + floor

    def state(self) -> dict[str, Any]:
        return {} if self._data is None else dict(zip(("wi", "wo", "f"), self._data))

    def restore(self, state: dict[str, Any], target: Target) -> None:
        if state:
            self._data = (np.array(state["wi"]), np.array(state["wo"]), np.array(state["f"]))
            self._fit(*self._data)
