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
from gonio.mcmc.draws import Draws
from gonio.mcmc.history import History
from gonio.mcmc.pilot import pilot_directions
from gonio.mcmc.proposals import LOCAL, PILOT
from gonio.mcmc.steps import StepLog, Steps
from gonio.mcmc.target import Target

MAX_FREE_ROUNDS = 10_000
FREE, WAITING, ANSWERED = 0, 1, 2


class NoSupport(RuntimeError):
    """No direction with a measurable value was found: the rig reaches nothing, or nothing reflects. One line."""

    exit_code = 2


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

    def __init__(self, plan, target: Target, *, chains: int, channels: int, seed: int, anisotropic: bool = False, reachable=None):
        self.plan, self.target, self.chains, self.channels = plan, target, chains, channels
        self.reachable = reachable
        self.draws = Draws(seed, chains, max(p.uniforms for p, _ in plan.kernels) + 2, max(p.normals for p, _ in plan.kernels))
        self.history = History(channels) if plan.learns else None
        self.log = StepLog(chains)
        self.step = 0  # steps settled or drawn, the same for every chain
        self.rounds = 0
        self.next_id = 0
        self.next_learn = 0
        self.free_rounds = 0
        self.unmeasured_in_a_row = 0
        # the chains' states
        self.wi, self.wo = np.zeros((chains, 3)), np.zeros((chains, 3))
        self.f = np.zeros((chains, channels))
        self.log_p = np.full(chains, -np.inf)
        self.at = np.full(chains, -1, np.int64)
        self.u: Array | None = None  # coordinates of the state in the proposal of the round before
        self.log_w = np.full(chains, -np.inf)
        self._kernel = -1
        self._round: dict[str, Any] | None = None
        if plan.learns or target.needs_scale:
            self._begin_pilot(anisotropic)

    # ---- the interface -------------------------------------------------------------------------------------------

    def ask(self) -> Batch:
        """What is needed next: all measurements of the round that were not told yet. Raises NoSupport."""
        while self._round is None:
            self._begin_round()
        r = self._round
        wanted = np.flatnonzero(r["status"] == WAITING)
        return Batch(r["ids"][wanted], r["wi"][wanted], r["wo"][wanted])

    def tell(self, ids, f, sigma=None) -> None:
        """BRDF values f (M, C) of measurements `ids`, NaN = could not be measured; any subset, in any order.

        sigma is accepted for the seam's sake: a chain keeps the value it was told and never asks again, which is
        exact for unbiased non-negative noise (pseudo-marginal). Raises KeyError for an id not asked for.
        """
        r = self._round
        f = np.asarray(f, float)
        ids = np.asarray(ids)
        if r is None or (len(ids) and (ids.min() < r["first_id"] or ids.max() >= self.next_id)):
            raise KeyError(f"measurement {ids} was not asked for")
        at = r["where"][ids - r["first_id"]]
        if (r["status"][at] != WAITING).any():
            raise KeyError(f"measurement {ids[r['status'][at] != WAITING]} was told before")
        r["f"][at] = f
        r["status"][at] = ANSWERED
        self._settle()

    def take_steps(self) -> Steps:
        """The step log since the last call."""
        return self.log.take()

    @property
    def steps_done(self) -> int:
        """Steps settled, per chain."""
        r = self._round
        return self.step + (r["settled"] if r is not None and not r["pilot"] else 0)

    def state(self) -> dict[str, Any]:
        """All there is to know; `restore` on a sampler built alike goes on bit for bit. Arrays, numbers, strings."""
        names = ("step", "rounds", "next_id", "next_learn", "free_rounds", "unmeasured_in_a_row", "_kernel")
        arrays = ("wi", "wo", "f", "log_p", "at", "log_w")
        return {
            **{k: getattr(self, k) for k in names},
            **{k: getattr(self, k).copy() for k in arrays},
            "u": None if self.u is None else self.u.copy(),
            "round": None if self._round is None else {k: v.copy() if hasattr(v, "copy") else v for k, v in self._round.items()},
            "history": self.history.state() if self.history is not None else None,
            "target": self.target.state(),
            "plan": self.plan.state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        for k in ("step", "rounds", "next_id", "next_learn", "free_rounds", "unmeasured_in_a_row", "_kernel"):
            setattr(self, k, int(state[k]))
        for k in ("wi", "wo", "f", "log_p", "at", "log_w"):
            setattr(self, k, np.array(state[k]))
        self.u = None if state["u"] is None else np.array(state["u"])
        r = state["round"]
        self._round = None if r is None else {k: v.copy() if hasattr(v, "copy") else v for k, v in r.items()}
        if self.history is not None:
            self.history.restore(state["history"])
        self.target.restore(state["target"])
        self.plan.restore(state["plan"])

    # ---- rounds ----------------------------------------------------------------------------------------------------

    def _begin_pilot(self, anisotropic: bool) -> None:
        wi, wo, log_q = pilot_directions(anisotropic)
        if self.reachable is not None:
            keep = self.reachable(wi, wo)
            wi, wo, log_q = wi[keep], wo[keep], log_q[keep]
        if len(wi):
            self._open(None, wi, wo, -log_q, np.full(len(wi), PILOT, np.int8), np.ones(len(wi), bool), pilot=True)

    def _begin_round(self) -> None:
        if self.history is not None and self.history.count >= self.next_learn:
            self.plan.learn(self.target, *self.history.without(self.at))
            self.next_learn = max(self.history.count + 32, int(1.5 * self.history.count))
            self._kernel = -1  # the densities changed: the states' weights are computed anew
            self._reweigh()
        k = self.rounds % len(self.plan.kernels)
        proposal, block = self.plan.kernels[k]
        uniform, normal = self.draws.rows(self.step, block)
        if k != self._kernel:
            self._enter(proposal, k)
        if block == 1:
            u_in, z = uniform[0, 2:], normal[0]
        else:
            u_in, z = uniform[:, 2:].transpose(1, 0, 2).reshape(-1, block * self.chains), normal.transpose(1, 0, 2).reshape(-1, block * self.chains)
        started = self.at >= 0
        all_started = bool(started.all())
        u, kind = proposal.propose(self.u if block == 1 and self.u is not None else None, u_in[: proposal.uniforms], z[: proposal.normals])
        if block == 1 and self.u is not None and not all_started:
            fresh, fresh_kind = proposal.propose(None, u_in[: proposal.uniforms], z[: proposal.normals])
            u, kind = np.where(started, u, fresh), np.where(started, kind, fresh_kind)
        wi, wo = proposal.to_directions(u)
        alive = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        if self.reachable is not None:
            if alive.all():
                alive = self.reachable(wi, wo)
            else:
                i = np.flatnonzero(alive)
                alive[i[~self.reachable(wi[i], wo[i])]] = False
        log_j = proposal.log_jacobian(u)
        self.rounds += 1
        self._open(u, wi, wo, log_j, kind, alive, pilot=False, block=block, coin=uniform[:, 1])
        screen = self.plan.screen
        if screen is not None and block == 1:
            self._screen(screen, log_j, uniform[0, 0])
        if self._round["waiting"] == 0:
            self.free_rounds += 1
            if self.free_rounds > MAX_FREE_ROUNDS:
                raise NoSupport(
                    f"{self.free_rounds} proposals in a row fell where nothing can be measured; "
                    "check the rig's limits and stay-out cone, or choose another proposal"
                )
        else:
            self.free_rounds = 0
        self._settle()

    def _open(self, u, wi, wo, log_j, kind, alive, *, pilot: bool, block: int = 1, coin=None) -> None:
        n = len(wi)
        where = np.flatnonzero(alive)
        ids = np.full(n, -1, np.int64)
        ids[where] = np.arange(self.next_id, self.next_id + len(where))
        self._round = {
            "u": u, "wi": wi, "wo": wo, "log_j": log_j, "kind": kind, "coin": coin, "ids": ids, "where": where,
            "f": np.full((n, self.channels), np.nan), "status": np.where(alive, WAITING, FREE).astype(np.int8),
            "first_id": self.next_id, "settled": 0, "block": block, "pilot": pilot, "waiting": len(where),
            "log_s": None,
        }  # fmt: skip
        self.next_id += len(where)

    def _enter(self, proposal, k: int) -> None:
        """The states' coordinates and weights under another proposal than that of the last round."""
        self._kernel = k
        if (self.at < 0).all():
            self.u = None
            return
        started = self.at >= 0
        wi, wo = self.wi.copy(), self.wo.copy()
        wi[~started] = wo[~started] = (0.0, 0.0, 1.0)
        self.u = proposal.from_directions(wi, wo)
        with np.errstate(invalid="ignore"):
            self.log_w = np.where(started, self.log_p + proposal.log_jacobian(self.u), -np.inf)

    def _reweigh(self) -> None:
        started = self.at >= 0
        self.log_p[started] = self.target.log_prob(self.f[started], self.wo[started, 2])

    def _screen(self, screen, log_j: Array, coin: Array) -> None:
        """First stage of delayed acceptance (Christen & Fox 2005): the surrogate rejects without a measurement.

        What passes is judged by the ratio of target to surrogate, new over old; `log_s` keeps the surrogate's part.
        """
        r = self._round
        started = self.at >= 0
        new = np.full(self.chains, -np.inf)
        i = r["where"]
        new[i] = self.target.log_prob(screen(r["wi"][i], r["wo"][i]), r["wo"][i, 2])
        old = np.full(self.chains, -np.inf)
        old[started] = self.target.log_prob(screen(self.wi[started], self.wo[started]), self.wo[started, 2])
        with np.errstate(invalid="ignore"):
            ratio = (new + log_j) - (old + self.log_w - self.log_p)
        refused = started & (r["status"] == WAITING) & (np.log(coin + 1e-300) >= ratio)
        keep = (r["status"] == WAITING) & ~refused
        where = np.flatnonzero(keep)
        self.next_id = r["first_id"] + len(where)
        r["ids"] = np.full(self.chains, -1, np.int64)
        r["ids"][where] = np.arange(r["first_id"], self.next_id)
        r["where"], r["waiting"] = where, len(where)
        r["status"] = np.where(keep, WAITING, FREE).astype(np.int8)
        r["log_s"] = np.where(started, new - old + log_j - (self.log_w - self.log_p), 0.0)

    # ---- judging ---------------------------------------------------------------------------------------------------

    def _settle(self) -> None:
        """Judge the steps of the round whose measurements are all there, in drawn order."""
        r = self._round
        if r["pilot"]:
            if not (r["status"] == WAITING).any():
                self._end_pilot()
            return
        c, status = self.chains, r["status"]
        waiting = status == WAITING
        ready = r["block"] if not waiting.any() else int(np.argmax(waiting)) // c
        if r["settled"] == ready:
            return
        new = slice(r["settled"] * c, ready * c)
        log_p = self._log_p(r, new)
        for b in range(r["settled"], ready):
            cell = slice(b * c, (b + 1) * c)
            part = log_p[cell.start - new.start : cell.stop - new.start]
            self._judge(r, b, cell, part)
        r["settled"] = ready
        if ready == r["block"]:
            self._end_round()

    def _log_p(self, r: dict, cells: slice) -> Array:
        """log target of proposals; -inf where outside the support or not measured."""
        f, status = r["f"][cells], r["status"][cells]
        log_p = self.target.log_prob(f, r["wo"][cells, 2])
        good = np.isfinite(f).all(1) & (status == ANSWERED)
        if good.all():
            return log_p
        return np.where(good, log_p, -np.inf)

    def _judge(self, r: dict, b: int, cell: slice, log_p: Array) -> None:
        log_w = log_p + r["log_j"][cell]
        # a chain without a state (-inf) takes the first place that can be measured
        measured = log_p > -np.inf
        gain = np.where(measured, log_w, 0.0) - np.where(measured, self.log_w, 0.0)
        if r["log_s"] is not None:
            gain = gain - r["log_s"]
        accepted = measured & (np.log(r["coin"][b] + 1e-300) < gain)
        kind = r["kind"][cell]
        ids = r["ids"][cell]
        if accepted.any():
            if accepted.all():
                self.wi, self.wo, self.f = r["wi"][cell].copy(), r["wo"][cell].copy(), r["f"][cell].copy()
                self.log_p, self.log_w, self.at = log_p, log_w, ids.copy()
                self.u = r["u"][:, cell].copy()
            else:
                a = accepted[:, None]
                self.wi, self.wo = np.where(a, r["wi"][cell], self.wi), np.where(a, r["wo"][cell], self.wo)
                self.f = np.where(a, r["f"][cell], self.f)
                self.log_p, self.log_w = np.where(accepted, log_p, self.log_p), np.where(accepted, log_w, self.log_w)
                self.at = np.where(accepted, ids, self.at)
                new = r["u"][:, cell]
                self.u = new.copy() if self.u is None else np.where(accepted, new, self.u)
        log_q = np.where(kind == LOCAL, np.nan, -r["log_j"][cell])
        self.log.add(self.step + b, kind, ids, accepted, log_q, self.at, self.log_p, r["wi"][cell], r["wo"][cell])

    def _end_round(self) -> None:
        r = self._round
        self.step += r["block"]
        answered = r["status"] == ANSWERED
        self._count_unmeasured(r["f"][answered])
        if self.history is not None:
            self._remember(r, answered)
        self._round = None

    def _remember(self, r: dict, answered: Array) -> None:
        good = answered & np.isfinite(r["f"]).all(1)
        log_q = np.where((r["kind"] == LOCAL), np.nan, -r["log_j"])
        self.history.add(r["ids"][good], r["wi"][good], r["wo"][good], r["f"][good], log_q[good])

    def _end_pilot(self) -> None:
        r = self._round
        good = np.isfinite(r["f"]).all(1)
        self._count_unmeasured(r["f"])
        if good.any():
            self.target.rescale(r["f"][good], r["wo"][good, 2], -r["log_j"][good])
        if self.history is not None:
            self._remember(r, good)
        self.log.add_pilot(r["ids"], -r["log_j"], r["wi"], r["wo"])
        self._round = None

    def _count_unmeasured(self, f: Array) -> None:
        good = np.isfinite(f).all(1)
        last = np.flatnonzero(good)[-1:]
        self.unmeasured_in_a_row = int(len(f) - 1 - last[0]) if len(last) else self.unmeasured_in_a_row + len(f)
