"""Where the chains are."""

from typing import Any

import numpy as np

from gonio.geometry import Array

NOWHERE = -1e308
NAMES = ("wi", "wo", "f", "log_p", "at", "log_w")


class Chains:
    """States of C chains: wi, wo (C, 3), f (C, channels), log_p (C,) log target, at (C,) measurement or -1.

    u (n, C) are the states' coordinates in the proposal in force and log_w = log p + log |d(wi, wo)/du| their weights;
    a chain that has not found the support has log_p = log_w = NOWHERE, below every weight and yet a number,
    so that no difference of two of them is a NaN.
    """

    def __init__(self, chains: int, channels: int):
        self.wi, self.wo = np.zeros((chains, 3)), np.zeros((chains, 3))
        self.wi[:, 2] = self.wo[:, 2] = 1
        self.f = np.zeros((chains, channels))
        self.log_p = np.full(chains, NOWHERE)
        self.log_w = np.full(chains, NOWHERE)
        self.at = np.full(chains, -1, np.int64)
        self.u: Array | None = None

    @property
    def started(self):
        return self.at >= 0

    def enter(self, proposal) -> None:
        """Coordinates and weights under another proposal."""
        started = self.started
        if not started.any():
            self.u = None
            return
        self.u = proposal.from_directions(self.wi, self.wo)
        self.log_w = self.log_p.copy()
        self.log_w[started] += proposal.log_jacobian(self.u)[started]

    def reweigh(self, target) -> None:
        """log_p anew after the target's albedos or floor changed."""
        started = self.started
        self.log_p = self.log_p.copy()  # the step log keeps the arrays it was given
        self.log_p[started] = target.log_prob(self.f[started], self.wi[started], self.wo[started])

    def move(self, accepted, u, wi, wo, f, log_p, log_w, ids) -> None:
        """Chains `accepted` (C,) go there; all arrays over chains, none of them changed later by anybody."""
        n = np.count_nonzero(accepted)
        if n == len(accepted):
            self.u, self.wi, self.wo, self.f, self.at, self.log_p, self.log_w = u, wi, wo, f, ids, log_p, log_w
        elif n:
            a = accepted[:, None]
            self.u = u if self.u is None else np.where(accepted, u, self.u)
            self.wi, self.wo, self.f = np.where(a, wi, self.wi), np.where(a, wo, self.wo), np.where(a, f, self.f)
            self.log_p, self.log_w = np.where(accepted, log_p, self.log_p), np.where(accepted, log_w, self.log_w)
            self.at = np.where(accepted, ids, self.at)

    def state(self) -> dict[str, Any]:
        return {**{k: getattr(self, k).copy() for k in NAMES}, "u": None if self.u is None else self.u.copy()}

    def restore(self, state: dict[str, Any]) -> None:
        for k in NAMES:
            setattr(self, k, np.array(state[k]))
        self.u = None if state["u"] is None else np.array(state["u"])
