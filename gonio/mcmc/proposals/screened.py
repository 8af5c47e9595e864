"""Independence draws thinned by a surrogate: hopeless ones are never measured, promising ones come as they should.

A draw y of the mixture q is kept with probability r(y) = rho + (1 - rho) min(1, p^(y) / (M q(y))), p^ the target made
of the running reconstruction. What is kept follows q r / a with a = E_q[r], so that the chain's ratio of weights is
that of p / (q r): the constant a cancels, and the chain is exact whatever the surrogate is worth. Draws that are not
kept are no steps: how many there were says nothing about where the chain is. rho keeps the weight bounded.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.geometry import Array, above_horizon
from gonio.mcmc.proposals.independence import Independence, Mixture, side_by_side

TRIES = 8  # draws of the mixture for each step wanted
KEPT = 0.2  # share of the draws to be kept; its inverse bounds how much a draw can be favoured
PLAIN = (
    0.15,
    0.4,
    0.75,
)  # shares of the kept draws that follow the mixture whatever the surrogate says, to choose from
POOL = 8192


class Screened:
    """A density to draw from: log_prob(wi, wo) (up to the error of the estimate of a) and keep(wi, wo, log_q, coin)."""

    def __init__(
        self, mixture: Mixture, log_surrogate: Callable[[Array, Array], Array], plain: float, log_ratio: Array
    ):
        """log_ratio: of surrogate to mixture on draws of the mixture (`ratios`), the same for every `plain`."""
        self.mixture, self.log_surrogate = mixture, log_surrogate
        self.rho = plain * KEPT
        self.log_m = _threshold(log_ratio, KEPT)
        self.log_a = float(np.log(np.mean(self._thinning(log_ratio))))

    def _thinning(self, log_ratio: Array) -> Array:
        return self.rho + (1 - self.rho) * np.exp(np.minimum(0.0, log_ratio - self.log_m))

    def thinned(self, wi: Array, wo: Array, coin: Array) -> tuple[Array, Array]:
        """Which draws (N,) of the mixture are kept for uniform coins (N,), and the log density of kept draws (N,)."""
        log_q = self.mixture.log_prob(wi, wo)
        r = self._thinning(self.log_surrogate(wi, wo) - log_q)
        return coin < r, log_q + np.log(r) - self.log_a

    def log_prob(self, wi: Array, wo: Array) -> Array:
        """log of q r / a, solid angles."""
        return self.thinned(wi, wo, np.zeros(len(wi)))[1]


def choose(mixtures: list[Any], log_surrogate, wi: Array, wo: Array, log_p: Array, log_q: Array):
    """Which of `mixtures` to draw from and, unless it serves best as it is (None), how to thin it: (mixture, Screened).

    The one whose weights vary least, judged on draws (N,) that neither mixture nor surrogate has seen: the second
    moment of the weights p / g is an average of (p / q)(p / g) over draws of density q.
    """
    pairs: list[tuple[Any, Screened | None]] = []
    for m in mixtures:
        log_ratio = ratios(m, log_surrogate)
        pairs += [(m, None), *((m, Screened(m, log_surrogate, plain, log_ratio)) for plain in PLAIN)]
    log_moments = [_log_mean(2 * log_p - log_q - (m if s is None else s).log_prob(wi, wo)) for m, s in pairs]
    return pairs[int(np.argmin(log_moments))]


def ratios(mixture, log_surrogate: Callable[[Array, Array], Array]) -> Array:
    """log of surrogate over mixture, on draws of the mixture."""
    wi, wo = mixture.sample(np.random.default_rng(0).random((5, POOL)))
    ok = above_horizon(wi, wo)
    wi, wo = wi[ok], wo[ok]
    return log_surrogate(wi, wo) - mixture.log_prob(wi, wo)


def _log_mean(x: Array) -> float:
    return float(x.max() + np.log(np.mean(np.exp(x - x.max()))))


def _threshold(log_ratio: Array, kept: float) -> float:
    """log M such that the mean of min(1, ratio / M) is `kept`, by bisection."""
    low, high = log_ratio.min() - 1, log_ratio.max() + 40
    for _ in range(60):
        middle = 0.5 * (low + high)
        if np.mean(np.exp(np.minimum(0.0, log_ratio - middle))) > kept:
            low = middle
        else:
            high = middle
    return float(high)


class ScreenedIndependence(Independence):
    """As `Independence`, from a mixture (`density`) or, once there is one, a `Screened` density (`screened`)."""

    uniforms = 6 * TRIES

    def __init__(self, density: Mixture):
        super().__init__(density)
        self.screened: Screened | None = None

    def draw_block(self, uniform: Array) -> tuple[Array, Array, Array, Array]:
        """As many steps as every chain has kept draws for, at most the block's length; perhaps none."""
        if self.screened is None:
            return super().draw_block(uniform[:, :5])
        block, _, chains = uniform.shape
        tries = uniform.reshape(block * TRIES, 6, chains)  # in drawn order
        flat = side_by_side(tries)
        wi, wo = self.density.sample(flat[:5])
        kept, log_q = np.zeros(len(wi), bool), np.full(len(wi), np.inf)
        above = np.flatnonzero(above_horizon(wi, wo))
        kept[above], log_q[above] = self.screened.thinned(wi[above], wo[above], flat[5, above])
        # the first draws kept by each chain, one row a step
        table = kept.reshape(-1, chains)
        length = min(block, int(table.sum(0).min()))
        order = np.argsort(~table, axis=0, kind="stable")[:length]
        index = (order * chains + np.arange(chains)).ravel()
        wi, wo = wi[index], wo[index]
        return np.concatenate([wi.T, wo.T]), wi, wo, -log_q[index]

    def log_jacobian(self, u: Array) -> Array:
        if self.screened is None:
            return super().log_jacobian(u)
        out = np.full(u.shape[1], -np.inf)
        above = (u[2] > 0) & (u[5] > 0)
        out[above] = -self.screened.log_prob(u[:3, above].T, u[3:, above].T)
        return out
