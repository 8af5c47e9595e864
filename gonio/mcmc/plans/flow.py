"""The plan `flow`: as `auto`, with a flow beside the lobes, and shares that the measurements decide.

After the pilot and at every refit (a growing schedule) candidates stand for election: the live flow, the one it
started from, the conditional flow at a code fitted anew, and (if `train`) the best of these trained on. All are fitted
to three quarters of the draws, weighted f / q, never those a chain now sits on (METHOD 8), and judged by the weighted
likelihood of the quarter kept back. So a candidate goes live only if it is better on what it has not seen, and a flow
that went wrong is rolled back at the next election. Every election is on record in `audit`. A flow that is worth
nothing gets no share: what is left is `auto`.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.config.material import FlowConfig
from gonio.flow import shipped
from gonio.flow.cubes import make_cube
from gonio.flow.density import FlowDensity
from gonio.flow.flow import Flow, FlowError, Shape
from gonio.geometry import Array
from gonio.mcmc.plans.auto import HELD_OUT, Auto
from gonio.mcmc.proposals.flow_mixture import FlowMixture, best_share
from gonio.mcmc.proposals.independence import Mixture
from gonio.mcmc.target import Target

FEWEST = 40  # draws below which nothing is fitted
TRAINED_FROM = 400  # draws from which on all weights are trained, not only the code
FRESH_FROM = 100  # the same of a flow that knows nothing yet
EPOCHS, BATCH, MOST_STEPS, RATE = 20, 256, 400, 1e-3
TRUNCATED = 0.5  # weights are cut at N^0.5 times their mean (Ionides 2008)


class FlowPlan(Auto):
    """See the module's text. `audit` holds one dict for every election. Raises FlowError for weights named in vain."""

    def __init__(
        self, c: FlowConfig, seed: int, *, block: int, anisotropic: bool, adapt: bool = True,
        fit_surrogate: Callable | None = None,
    ):  # fmt: skip
        super().__init__(block=block, anisotropic=anisotropic, adapt=adapt, fit_surrogate=fit_surrogate)
        self.config, self.seed, self.anisotropic = c, seed, anisotropic
        self.cube = make_cube(c.coordinates if c.start == "fresh" or anisotropic else "half", c.alpha, anisotropic)
        self._own = None if c.weights is None else shipped.load_conditional(c.weights)
        self.audit: list[dict[str, Any]] = []
        self.start: Flow | None = None
        self.live: Flow | None = None
        self.share = 0.0

    def _fit_density(self, wi: Array, wo: Array, log_w: Array) -> None:
        super()._fit_density(wi, wo, log_w)
        if len(wi) >= FEWEST:
            self._elect(wi, wo, log_w)

    def _elect(self, wi: Array, wo: Array, log_w: Array) -> None:
        x = self.cube.from_directions(wi, wo)
        w = truncated(log_w)
        held = kept_back(wo)
        candidates: dict[str, Flow] = {}
        try:
            candidates = self._candidates(x[~held], w[~held], x[held], w[held])
        except FlowError as e:
            self.audit.append({"draws": len(x), "chosen": "none", "why": str(e)})
            self.live, self.share = None, 0.0
            return
        score = {k: mean_log_prob(q, x[held], w[held]) for k, q in candidates.items()}
        chosen = max(score, key=lambda k: score[k])
        self.live = candidates[chosen]
        lobes = Mixture(self.dictionary, self.shares).log_prob(wi[held], wo[held])
        flow = FlowDensity(self.live, self.cube).log_prob(wi[held], wo[held])
        self.share = best_share(lobes, flow, w[held])
        self.audit.append({"draws": len(x), "chosen": chosen, "share": round(self.share, 4), **score})

    def _candidates(self, x: Array, w: Array, held_x: Array, held_w: Array) -> dict[str, Flow]:
        """By name; raises FlowError where the samples are of no use or the weights that ship are spoilt."""
        out: dict[str, Flow] = {}
        start = self.config.start if not self.anisotropic else "fresh"
        if self.live is not None:
            out["live"] = self.live
        if start == "zoo" and self.start is None:
            self.start = max((q for _, q in shipped.zoo()), key=lambda q: mean_log_prob(q, x, w))
        if start == "fresh" and self.start is None:
            self.start = Flow.fresh(self._fresh_shape(), np.random.default_rng(self.seed))
        if start == "code":
            flow, codes = self._own or shipped.conditional()
            self.start = flow.at(codes.fit(flow, x, w, None if self.start is None else self.start.code))
        assert self.start is not None
        out["start"] = self.start
        enough = FRESH_FROM if start == "fresh" else TRAINED_FROM
        if self.config.train and len(x) >= enough and (train := trainer()) is not None:
            best = max(out.values(), key=lambda q: mean_log_prob(q, held_x, held_w))
            steps = min(MOST_STEPS, EPOCHS * len(x) // BATCH)
            rng = np.random.default_rng([self.seed, len(x)])
            out["trained"] = train(best, x, w, steps=steps, batch=BATCH, rate=RATE, rng=rng).flow
        return out

    def _fresh_shape(self) -> Shape:
        c = self.config
        network = {"couplings": c.couplings, "bins": c.bins, "hidden": c.hidden}
        return Shape.of(self.cube, warp=c.warp, encoding=c.encoding, **network)

    @property
    def density(self) -> FlowDensity | None:
        """The live flow."""
        return None if self.live is None else FlowDensity(self.live, self.cube)

    def _densities(self) -> list[Any]:
        lobes = super()._densities()
        if self.live is None or self.share <= 0:
            return lobes
        return [FlowMixture(lobes[0], FlowDensity(self.live, self.cube), self.share, self.config.epsilon), *lobes]

    def state(self) -> dict[str, Any]:
        flows = {k: None if q is None else q.to_arrays() for k, q in (("start", self.start), ("live", self.live))}
        return {**super().state(), "flow": flows, "share": self.share, "audit": list(self.audit)}

    def restore(self, state: dict[str, Any], target: Target) -> None:
        self.start, self.live = (
            None if state["flow"][k] is None else Flow.from_arrays(state["flow"][k]) for k in ("start", "live")
        )
        self.share, self.audit = float(state["share"]), list(state["audit"])
        super().restore(state, target)


def trainer() -> Callable | None:
    """`gonio.flow.train.train`, None where torch is not installed: the code is fitted all the same."""
    try:
        from gonio.flow.train import train
    except ImportError:
        return None
    return train


def kept_back(wo: Array) -> Array:
    """Which draws (N,) are for judging, about one in HELD_OUT; a draw keeps its part whatever else comes or goes."""
    return np.floor(np.abs(wo[:, 0]) * 2**30) % HELD_OUT == 0


def truncated(log_w: Array) -> Array:
    """Weights (N,) of mean 1, cut at N^TRUNCATED; 0 where they are not numbers."""
    finite = np.isfinite(log_w)
    if not finite.any():
        return np.zeros(len(log_w))
    w = np.where(finite, np.exp(log_w - log_w[finite].max()), 0.0)
    w = np.minimum(w, w.mean() * len(w) ** TRUNCATED)
    return w / w.mean()


def mean_log_prob(flow: Flow, x: Array, w: Array) -> float:
    """Weighted mean of log q over points of the cube."""
    return float(w @ flow.log_prob(x) / w.sum()) if w.sum() > 0 else -np.inf
