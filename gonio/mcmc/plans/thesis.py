"""The plan of `adapt: thesis`: a walk through the flow, which is trained on the states the chain accepts.

Kept to show what it does (METHOD 4, 8). Where flow and chain miss a part of the target no accepted state will ever lie
there, and what is likely becomes likelier: the acceptance looks excellent while the samples go wrong.
"""

from typing import Any

import numpy as np

from gonio.config.material import SamplerConfig
from gonio.flow import shipped
from gonio.flow.cubes import make_cube
from gonio.flow.density import FlowDensity
from gonio.flow.flow import Flow, FlowError
from gonio.geometry import Array
from gonio.mcmc.plans.flow import mean_log_prob, truncated
from gonio.mcmc.proposals.flow_pss import FlowPss
from gonio.mcmc.target import Target

FEWEST, STEPS, BATCH, RATE = 40, 100, 128, 1e-3


class ThesisFlow:
    """See the module's text."""

    learns = True
    screen = None

    def __init__(self, c: SamplerConfig, seed: int):
        flow = shipped.zoo()[len(shipped.zoo()) // 2][1]
        self.cube, self.seed, self.chosen = make_cube("half", 0.1), seed, False
        self.proposal = FlowPss(
            FlowDensity(flow, self.cube), sigma=c.sigma, global_share=c.global_share, boundary=c.boundary
        )
        self.kernels = [(self.proposal, 1)]
        self.accepted = np.empty((0, 3))
        self.audit: list[dict[str, Any]] = []

    def follow(self, accepted: Array, wi: Array, wo: Array) -> None:
        """Remember the states that chains moved to."""
        if accepted.any():
            self.accepted = np.concatenate([self.accepted, self.cube.from_directions(wi[accepted], wo[accepted])])

    def learn(self, target: Target, wi: Array, wo: Array, f: Array, log_q: Array) -> None:
        """The zoo's best by the pilot first; then maximum likelihood on all states accepted so far."""
        known = np.isfinite(log_q)
        if known.any() and (f[known] > 0).any() and not self.chosen:
            target.rescale(f[known], wo[known, 2], log_q[known])
            x = self.cube.from_directions(wi[known], wo[known])
            w = truncated(target.log_prob(f[known], wi[known], wo[known]) - log_q[known])
            self._use(max((q for _, q in shipped.zoo()), key=lambda q: mean_log_prob(q, x, w)))
            self.chosen = True
        if len(self.accepted) < FEWEST:
            return
        from gonio.flow.train import train

        rng = np.random.default_rng([self.seed, len(self.accepted)])
        try:
            done = train(self.proposal.density.flow, self.accepted, steps=STEPS, batch=BATCH, rate=RATE, rng=rng)
        except FlowError as e:
            self.audit.append({"draws": len(self.accepted), "chosen": "live", "why": str(e)})
            return
        self._use(done.flow)
        self.audit.append({"draws": len(self.accepted), "chosen": "trained", "loss": float(done.losses[-1])})

    @property
    def density(self) -> FlowDensity:
        """The live flow."""
        return self.proposal.density

    def _use(self, flow: Flow) -> None:
        self.proposal.density = FlowDensity(flow, self.cube)

    def state(self) -> dict[str, Any]:
        return {
            "flow": self.proposal.density.flow.to_arrays(),
            "accepted": self.accepted.copy(),
            "chosen": self.chosen,
            "audit": list(self.audit),
        }

    def restore(self, state: dict[str, Any], target: Target) -> None:
        self._use(Flow.from_arrays(state["flow"]))
        self.accepted, self.chosen, self.audit = np.array(state["accepted"]), bool(state["chosen"]), state["audit"]
