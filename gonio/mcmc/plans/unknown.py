"""The default plan: look where the reconstruction does not know yet, in blocks that are one tour of the rig each.

A pilot of PILOT directions, then blocks as large as all before them. Every block is an epoch: the running
reconstruction says where samples are missing (gonio.mcmc.plans.epoch). Half of a block is drawn with known
probabilities, spread out by the local pivotal method; the other half fills the holes that are left, greedily.

What is drawn has weights: integrals made of it are unbiased, whatever the reconstruction is worth. The first draw of
each chain is its one step of the block, Metropolis-Hastings on the epoch's target. One, since a second draw keeps away
from the first: by itself each follows the density q exactly, given the other it does not. What fills holes has no
density; it is measured, learnt from, and no step.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array, from_half_diff
from gonio.mcmc.plans.blind import Blind
from gonio.mcmc.plans.epoch import Epoch
from gonio.mcmc.proposals import DRAWN, FILL, INDEPENDENCE
from gonio.mcmc.proposals.pivotal import pivotal
from gonio.mcmc.proposals.pool import LOWEST, evenly
from gonio.mcmc.proposals.spread import fill
from gonio.mcmc.target import Target, Unknown

PILOT, MOST_OF_PILOT = 24, 1024
SMALLEST, LARGEST = 16, 8192  # of a block
STRETCHED = 1.5  # times its size a block may have to be the last before the budget
DRAWN_SHARE = 0.5
CANDIDATES, PER_PICK, MOST_CANDIDATES = 2**14, 24, 2**17
FILL_FROM = 12  # candidates for each that fills a hole
SEVERAL = 1.1  # slots for a draw, so that how many there are tells a chain nothing
EMPTY = -1


@dataclass(frozen=True)
class Block:
    """What a block measures: wi, wo (N, 3), log_q (N,) log density (NaN: none), kind (N,), log_rest (N,) the frozen
    part of the target. The first rows are the chains' proposals, of which those not `alive` (N,) are settled free of
    charge: a slot with no draw in it."""

    wi: Array
    wo: Array
    log_q: Array
    kind: NDArray[np.int8]
    alive: NDArray[np.bool_]
    log_rest: Array


class UnknownPlan:
    """fit(wi, wo, f, sigma) -> Running makes the running reconstruction, or None where it cannot yet. reachable(wi, wo)
    -> (N,) bool as in `Sampler`. cuts: counts of measurements at which a block has to end, the budgets of the run.
    asked: as in `Epoch`."""

    learns, screen = True, None
    uniforms = normals = 0

    def __init__(
        self,
        fit: Callable | None,
        *,
        anisotropic: bool,
        reachable: Callable | None = None,
        cuts: tuple[int, ...] = (),
        adapt: bool = True,
        asked: Callable | None = None,
    ):
        self.fit, self.anisotropic, self.cuts, self.adapt, self.asked = fit, anisotropic, cuts, adapt, asked
        self.support = reachable or (lambda wi, wo: np.ones(len(wi), bool))
        self.kernels = [(self, 1)]
        self.epoch: Epoch | None = None
        self._seen: dict[str, Array] | None = None

    def pilot(self) -> tuple[Array, Array, Array, int]:
        """wi, wo, log_q of first directions, and how many are measured of those that the rig reaches."""
        return *first_directions(self.anisotropic), PILOT

    def design(
        self, target: Unknown, history: dict[str, Array], asked: int, chains: int, key: tuple[int, int]
    ) -> Block:
        """The next block of a run that has asked for so many measurements. history: wi, wo, f, sigma, log_q of what it
        may know; key: seed and number of the block."""
        if self.epoch is None or self.adapt:
            self._seen = {**history, "key": np.array(key)}
            self._begin(target)
        assert self.epoch is not None
        rng = _generator(key, 1)
        return draw(self.epoch, self._size(asked), chains, rng)

    def _begin(self, target: Unknown) -> None:
        assert self._seen is not None
        s = self._seen
        running = Blind(s["f"].shape[1])
        if self.fit is not None and len(s["f"]):
            running = self.fit(s["wi"], s["wo"], s["f"], s["sigma"]) or running
        rng = _generator((int(s["key"][0]), int(s["key"][1])), 0)
        self.epoch = Epoch(running, target, (s["wi"], s["wo"]), self.support, rng, self.asked)
        target.epoch = self.epoch

    def _size(self, asked: int) -> int:
        size = min(max(SMALLEST, asked), LARGEST)
        left = min((c for c in self.cuts if c > asked), default=10**9) - asked
        return left if left <= STRETCHED * size else size

    def learn(self, target: Target, *_) -> None:
        """Nothing: each block begins with learning."""

    def state(self) -> dict[str, Any]:
        return {"seen": None if self._seen is None else {k: v.copy() for k, v in self._seen.items()}}

    def restore(self, state: dict[str, Any], target: Target) -> None:
        if state["seen"] is not None:
            assert isinstance(target, Unknown)
            self._seen = {k: np.array(v) for k, v in state["seen"].items()}
            self._begin(target)


def draw(epoch: Epoch, size: int, chains: int, rng: np.random.Generator) -> Block:
    """`size` measurements, about half of them drawn; at least one draw for every chain."""
    wanted = max(int(np.ceil(DRAWN_SHARE * size)), chains)
    pool = int(min(max(CANDIDATES, 2 ** np.ceil(np.log2(PER_PICK * size))), MOST_CANDIDATES))
    wi, wo = epoch.candidates(pool, rng)
    log_b = epoch.pool.log_prob(wi, wo)
    view = epoch.view(wi, wo)
    epoch.expect(wanted, pool)
    log_r = epoch.log_drawn(view.log_p, log_b)
    drawn = rng.permutation(pivotal(view.x, np.exp(log_r), rng))
    # with a the share that was drawn, sums over draws of 1 / q are unbiased (Horvitz & Thompson 1952): each candidate
    # was drawn with exactly r. Steps do not mind, the state's density has the same a
    epoch.log_a = float(np.log(max(len(drawn), 1) / pool))
    slots = np.full(max(int(np.ceil(SEVERAL * wanted)) + 2, len(drawn)), EMPTY)
    slots[rng.permutation(len(slots))[: len(drawn)]] = drawn
    steps, others = slots[:chains], slots[chains:]
    others = others[others != EMPTY]
    # how many candidates of a volume there are does not say how many samples it deserves
    deserved = view.log_volume - np.log(epoch.running.measure(wi, wo) + 1e-300) - log_b
    share = np.exp(np.maximum(deserved - deserved.max(), -600.0))  # none so little that it cannot be chosen
    few = FILL_FROM * size
    some = rng.choice(len(wi), few, replace=False, p=share / share.sum()) if 3 * few < len(wi) else np.arange(len(wi))
    spacing = np.exp((view.log_volume[some] - view.log_volume.max()) / epoch.running.dimensions)
    around = np.concatenate([epoch.occupied, view.x[drawn]])
    filled = some[fill(view.x[some], spacing, max(size - len(drawn), 0), around)]
    rows = np.concatenate([steps, others, filled])
    log_q = log_b + log_r - epoch.log_a
    kinds = np.repeat(np.array([INDEPENDENCE, DRAWN, FILL], np.int8), [len(steps), len(others), len(filled)])
    known = np.where(kinds == FILL, np.nan, log_q[rows])
    return Block(wi[rows], wo[rows], known, kinds, rows != EMPTY, view.log_rest[rows])


def first_directions(anisotropic: bool) -> tuple[Array, Array, Array]:
    """wi, wo (N, 3) and log_q (N,): quasi-random in (theta_h = pi/2 u^2, theta_d, phi_d), close together at the peak;
    the first PILOT of those that can be measured are the pilot, in any number a fair look."""
    u = evenly(MOST_OF_PILOT)
    theta_h, theta_d = np.pi / 2 * u[:, 0] ** 2, np.pi / 2 * u[:, 1]
    wi, wo = from_half_diff(theta_h, 2 * np.pi * u[:, 3] if anisotropic else 0 * u[:, 3], theta_d, 2 * np.pi * u[:, 2])
    solid = 4 * np.cos(theta_d) * np.sin(theta_d) * np.sin(theta_h) * np.sqrt(2 * np.pi * theta_h)
    log_q = -np.log(solid * np.pi / 2 * 4 * np.pi**2)
    keep = (wi[:, 2] > LOWEST) & (wo[:, 2] > LOWEST)
    return wi[keep], wo[keep], log_q[keep]


def _generator(key: tuple[int, int], stream: int) -> np.random.Generator:
    # keys of chains are pairs: three numbers are nobody else's
    return np.random.default_rng(np.random.SeedSequence(key[0], spawn_key=(stream, key[1], 0)))
