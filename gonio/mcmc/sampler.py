"""Ask/tell Metropolis-Hastings over arrays of chains: the one interface between chain and world.

    batch = sampler.ask()            # what is to be measured next
    sampler.tell(batch.ids, f)       # any subset, in any order

All chains step together. One *round* is a block of steps by one proposal: one step where each depends on the last,
many where they do not (independence). Steps are judged in drawn order as soon as the measurements they need are there,
so neither the order nor the grouping of answers changes what the chain does.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.mcmc.chain.chains import Chains
from gonio.mcmc.chain.draws import Draws
from gonio.mcmc.chain.history import History
from gonio.mcmc.chain.pilot import pilot_directions
from gonio.mcmc.chain.round import Round
from gonio.mcmc.chain.steps import StepLog, Steps
from gonio.mcmc.chain.support import NoSupport
from gonio.mcmc.proposals import FILL, INDEPENDENCE, LOCAL, PILOT
from gonio.mcmc.target import Target

MAX_FREE_ROUNDS = 10_000
COUNTERS = ("step", "row", "rounds", "next_id", "next_learn", "free_rounds", "unmeasured_in_a_row", "kernel")
TINY = 1e-300


@dataclass(frozen=True)
class Batch:
    """Measurements wanted: ids (M,) ascending in drawn order, wi and wo (M, 3)."""

    ids: NDArray[np.int64]
    wi: Array
    wo: Array


class Sampler:
    """Chains of a `plan` (which proposals, in which blocks, what they learn; see gonio.mcmc.plans) on a target.

    reachable(wi, wo) -> (N,) bool is the rig's part of the target's support. A proposal outside the support has
    weight 0: a step of the chain, rejected, never measured.
    """

    def __init__(
        self, plan, target: Target, *, chains: int, channels: int, seed: int, anisotropic: bool = False, reachable=None
    ):
        self.plan, self.target, self.channels, self.reachable = plan, target, channels, reachable
        self.chains = Chains(chains, channels)
        self.count = chains
        uniforms, normals = (max(getattr(p, k) for p, _ in plan.kernels) for k in ("uniforms", "normals"))
        self.draws = Draws(seed, chains, uniforms + 2, normals)
        self.history = History(channels) if plan.learns else None
        self._follow = getattr(plan, "follow", None)
        self.log = StepLog(chains)
        self.step = 0  # steps of the rounds closed so far, the same for every chain
        self.row = 0  # rows of random numbers used
        self.rounds = self.next_id = self.next_learn = self.free_rounds = self.unmeasured_in_a_row = 0
        self.kernel = -1  # which of the plan's kernels the chains' coordinates belong to
        self._round: Round | None = None
        self._pilot = False
        self._all_started = False
        if plan.learns or target.needs_scale:
            self._begin_pilot(anisotropic)

    # ---- the interface

    def ask(self) -> Batch:
        """What is needed next: all measurements of the round that were not told yet. Raises NoSupport."""
        while (r := self._round) is None:
            if hasattr(self.plan, "design"):
                self._begin_block()
            else:
                self._begin_round()
        return Batch(*r.wanted())

    def tell(self, ids, f, sigma=None) -> None:
        """BRDF values f (M, C) of measurements `ids`, NaN = could not be measured; any subset, in any order.

        sigma (M, C), as far as it is known, is for plans that learn; a chain keeps the value it was told and never
        asks again, exact for unbiased non-negative noise (pseudo-marginal). Raises KeyError for an id not asked for.
        """
        ids = np.asarray(ids, np.int64)
        if len(ids) == 0:
            return
        if self._round is None:
            raise KeyError(f"measurements {ids} were not asked for")
        self._round.answer(ids, np.asarray(f, float), None if sigma is None else np.asarray(sigma, float))
        self._settle(self._round)

    def take_steps(self) -> Steps:
        """The step log since the last call."""
        return self.log.take()

    def state(self) -> dict[str, Any]:
        """All there is to know; `restore` on a sampler built alike goes on bit for bit. Arrays, numbers, None."""
        return {
            **{k: getattr(self, k) for k in COUNTERS},
            "chains": self.chains.state(),
            "round": None if self._round is None else self._round.state(),
            "pilot": self._pilot,
            "history": None if self.history is None else self.history.state(),
            "target": self.target.state(),
            "plan": self.plan.state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        for k in COUNTERS:
            setattr(self, k, int(state[k]))
        self.chains.restore(state["chains"])
        self._round = None if state["round"] is None else Round.from_state(state["round"])
        self._pilot = bool(state["pilot"])
        if self.history is not None:
            self.history.restore(state["history"])
        self.target.restore(state["target"])
        self.plan.restore(state["plan"], self.target)

    # ---- rounds

    def _begin_pilot(self, anisotropic: bool) -> None:
        wi, wo, log_q, most = (
            self.plan.pilot() if hasattr(self.plan, "pilot") else (*pilot_directions(anisotropic), None)
        )
        keep = np.flatnonzero(self._supported(wi, wo))[:most]
        if len(keep):
            wi, wo, log_q = wi[keep], wo[keep], log_q[keep]
            kind, alive, coin = np.full(len(wi), PILOT, np.int8), np.ones(len(wi), bool), np.empty((1, len(wi)))
            self._open(Round.of(None, wi, wo, -log_q, kind, coin, alive, **self._sizes(1)))
            self._pilot = True

    def _begin_round(self) -> None:
        self._learn()
        k = self.rounds % len(self.plan.kernels)
        proposal, block = self.plan.kernels[k]
        if k != self.kernel:
            self.chains.enter(proposal)
            self.kernel = k
        uniform, normal = self.draws.rows(self.row, block)
        self.row += block
        coins = np.log(uniform[:, :2] + TINY)
        if hasattr(proposal, "draw_block"):
            u, wi, wo, log_j = proposal.draw_block(uniform[:, 2 : 2 + proposal.uniforms])
            kind, block = np.full(len(wi), INDEPENDENCE, np.int8), len(wi) // self.count
            alive, log_s = self._alive(wi, wo), None
        else:
            u, kind = self._propose(proposal, uniform[0, 2 : 2 + proposal.uniforms], normal[0, : proposal.normals])
            wi, wo, log_j = proposal.place(u)
            alive, log_s = self._alive(wi, wo), None
            if self.plan.screen is not None:
                alive, log_s = self._screen(wi, wo, log_j, alive, coins[0, 0])
        self.rounds += 1
        r = Round.of(u, wi, wo, log_j, kind, coins[:, 1], alive, log_s=log_s, **self._sizes(block))
        if block == 0:  # no chain-long row of draws was kept: as if it had never been drawn
            return
        self._open(r)
        self.free_rounds = self.free_rounds + 1 if r.unanswered == 0 else 0
        if self.free_rounds > MAX_FREE_ROUNDS:
            raise NoSupport(
                f"{self.free_rounds} proposals in a row fell where nothing can be measured; "
                "check the rig's limits and stay-out cone, or choose another proposal"
            )
        if len(r.where) < len(wi):  # what is free needs no answer
            self._settle(r)

    def _begin_block(self) -> None:
        """A block designed as a whole: the chains' proposals, one step of each, and measurements that are no step."""
        assert self.history is not None  # a plan that designs learns
        known = self.history.without(self.chains.at)
        d = self.plan.design(self.target, known, self.next_id, self.count, (self.draws.seed, self.rounds))
        self.chains.reweigh(self.target)
        self.chains.enter(self.plan.epoch)
        uniform, _ = self.draws.rows(self.row, 1)
        self.row += 1
        self.rounds += 1
        u, coins = np.concatenate([d.wi.T, d.wo.T]), np.log(uniform[:, 1] + TINY)
        if not d.alive.any():
            raise NoSupport("no pair of directions can be measured; check the rig's limits and stay-out cone")
        self._open(Round.of(u, d.wi, d.wo, -d.log_q, d.kind, coins, d.alive, log_rest=d.log_rest, **self._sizes(1)))

    def _open(self, r: Round) -> None:
        self._round = r
        self.next_id += len(r.where)

    def _sizes(self, block: int) -> dict[str, int]:
        return {"channels": self.channels, "first_id": self.next_id, "block": block}

    def _learn(self) -> None:
        if self.history is None or self.history.count < self.next_learn:
            return
        known = self.history.without(self.chains.at)
        self.plan.learn(self.target, *(known[k] for k in ("wi", "wo", "f", "log_q")))
        self.next_learn = max(self.history.count + 32, int(1.5 * self.history.count))
        self.chains.reweigh(self.target)
        self.kernel = -1  # densities changed: the states' weights are computed anew

    def _propose(self, proposal, uniform: Array, normal: Array) -> tuple[Array, Array]:
        if self.chains.u is None:
            return proposal.propose(None, uniform, normal)
        u, kind = proposal.propose(self.chains.u, uniform, normal)
        if not self._all_started:
            started = self.chains.started
            self._all_started = bool(started.all())
            fresh, fresh_kind = proposal.propose(None, uniform, normal)
            u, kind = np.where(started, u, fresh), np.where(started, kind, fresh_kind)
        return u, kind

    def _alive(self, wi: Array, wo: Array) -> NDArray[np.bool_]:
        alive = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        i = alive.nonzero()[0]
        alive[i] = self._supported(wi[i], wo[i])
        return alive

    def _supported(self, wi: Array, wo: Array) -> NDArray[np.bool_]:
        return np.ones(len(wi), bool) if self.reachable is None else self.reachable(wi, wo)

    def _screen(self, wi: Array, wo: Array, log_j: Array, alive, log_coin: Array) -> tuple[NDArray[np.bool_], Array]:
        """First stage of delayed acceptance (Christen & Fox 2005): the surrogate rejects without a measurement.

        What passes is judged by the ratio of target to surrogate; the second value is the surrogate's part of it.
        """
        c, started = self.chains, self.chains.started
        new, old = np.full(self.count, -np.inf), np.zeros(self.count)
        new[alive] = self.target.log_prob(self.plan.screen(wi[alive], wo[alive]), wi[alive], wo[alive])
        old[started] = self.target.log_prob(
            self.plan.screen(c.wi[started], c.wo[started]), c.wi[started], c.wo[started]
        )
        jacobian = c.log_w - c.log_p  # 0 where not started
        ratio = np.where(alive & started, new + log_j - old - jacobian, 0.0)
        return alive & (log_coin < ratio), ratio

    # ---- judging

    def _settle(self, r: Round) -> None:
        """Judge the steps of the round whose measurements are all there, in drawn order."""
        if self._pilot:
            if r.unanswered == 0:
                self._end_pilot(r)
            return
        ready = r.ready(self.count)
        if ready > r.settled:
            log_p, f, ids = r.values(self.target)
            for b in range(r.settled, ready):
                cell = slice(b * self.count, (b + 1) * self.count)
                self._judge(r, b, cell, log_p[cell], f[cell], ids[cell])
            r.settled = ready
        if r.settled == r.block and r.unanswered == 0:
            self._end_round(r)

    def _judge(self, r: Round, b: int, cell: slice, log_p: Array, f: Array, ids: NDArray[np.int64]) -> None:
        assert r.u is not None  # only the pilot has no coordinates, and it is not judged
        chains, wi, wo, log_j = self.chains, r.wi[cell], r.wo[cell], r.log_j[cell]
        log_w = log_p + log_j
        gain = log_w - chains.log_w
        if r.log_s is not None:
            gain = gain - r.log_s[cell]
        accepted = r.log_coin[b] < gain
        chains.move(accepted, r.u[:, cell], wi, wo, f, log_p, log_w, ids)
        if self._follow is not None:
            self._follow(accepted, wi, wo)
        self.log.add(self.step + b, r.kind[cell], ids, accepted, log_j, chains.at, chains.log_p, wi, wo)

    def _end_round(self, r: Round) -> None:
        others = slice(r.block * self.count, None)
        if len(r.wi) > r.block * self.count:
            log_p, _, ids = r.values(self.target)
            log_p[r.kind == FILL] = np.nan
            self.log.add_others(
                self.step + 1, ids[others], r.kind[others], -r.log_j[others], log_p[others], r.wi[others], r.wo[others]
            )
        self.step += r.block
        self._close(r)

    def _end_pilot(self, r: Round) -> None:
        good = np.isfinite(r.f).all(1)
        if good.any():
            self.target.rescale(r.f[good], r.wo[good, 2], -r.log_j[good])
        self.log.add_others(0, r.ids(), r.kind, -r.log_j, np.full(len(r.wi), np.nan), r.wi, r.wo)
        self._pilot = False
        self._close(r)

    def _close(self, r: Round) -> None:
        self._round = None
        if self.history is None and np.isfinite(r.f.sum()):
            self.unmeasured_in_a_row = 0
            return
        measured, told = np.flatnonzero(np.isfinite(r.f).all(1)), len(r.f)
        row = told - 1 - measured[-1] if len(measured) else self.unmeasured_in_a_row + told
        self.unmeasured_in_a_row = int(row)
        if self.history is not None:
            i = r.where[measured]
            log_q = np.where(r.kind[i] == LOCAL, np.nan, -r.log_j[i])
            self.history.add(r.first_id + measured, r.wi[i], r.wo[i], r.f[measured], r.sigma[measured], log_q)
