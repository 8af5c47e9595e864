"""A mixture of lobes, a flow and a uniform part as one density: what the flow misses, the others still find."""

import numpy as np

from gonio.flow.cubes import HalfCube
from gonio.flow.density import LOG_MIRRORED, LOG_TURN, FlowDensity
from gonio.geometry import Array
from gonio.mcmc.proposals.independence import Mixture

EPSILON = 0.02  # of draws even in the `half` cube, whatever is learnt: containment


class FlowMixture:
    """shares: epsilon uniform in the cube, `share` the flow's, the rest the lobes'. Density and draws as `Mixture`."""

    def __init__(self, lobes: Mixture, flow: FlowDensity, share: float, epsilon: float = EPSILON):
        self.lobes, self.flow, self.epsilon = lobes, flow, epsilon
        self.share = share
        self.shares = np.array([epsilon, share * (1 - epsilon), (1 - share) * (1 - epsilon)])
        self._even = HalfCube(anisotropic=not flow.isotropic)
        self._edges = np.cumsum(self.shares)[:2]

    def parts(self, wi: Array, wo: Array) -> Array:
        """log density of uniform, flow and lobes, (3, N)."""
        x = self._even.from_directions(wi, wo)
        even = -self._even.log_jacobian(x, wi, wo) - (LOG_MIRRORED + LOG_TURN if self.flow.isotropic else 0.0)
        return np.stack([even, self.flow.log_prob(wi, wo), self.lobes.log_prob(wi, wo)])

    def log_prob(self, wi: Array, wo: Array) -> Array:
        """log q (N,), solid angles; both directions above the horizon."""
        with np.errstate(divide="ignore"):
            return _log_sum(self.parts(wi, wo) + np.log(self.shares)[:, None])

    def sample(self, uniform: Array) -> tuple[Array, Array]:
        """wi, wo (N, 3) from uniform (5, N); wo may fall below the horizon."""
        pick = uniform[0]
        part = np.searchsorted(self._edges, pick, "right")
        low, high = np.concatenate([[0.0], self._edges])[part], np.concatenate([self._edges, [1.0]])[part]
        again = uniform.copy()
        again[0] = np.clip((pick - low) / (high - low), 0, 1 - 1e-16)  # what is left of the number that chose the part
        wi, wo = np.empty((2, len(pick), 3))
        for k, draw in enumerate((self._draw_even, self.flow.sample, self.lobes.sample)):
            mine = part == k
            if mine.any():
                wi[mine], wo[mine] = draw(again[:, mine])
        return wi, wo

    def _draw_even(self, uniform: Array) -> tuple[Array, Array]:
        return self.flow.placed(self._even, uniform[5 - self._even.dimensions :].T, uniform)


def best_share(lobes: Array, flow: Array, w: Array, largest: float = 0.95) -> float:
    """The flow's share in [0, largest] that maximises the weighted likelihood of sum (1 - s) lobes + s flow, by EM.

    lobes, flow: log densities (N,) of samples of weights w (N,) >= 0 that the flow was not fitted to.
    """
    if not w.sum() > 0:
        return 0.0
    w = w / w.sum()
    odds = np.exp(np.clip(flow - lobes, -50, 50))
    s = 0.5
    for _ in range(60):
        s = float(w @ (s * odds / (1 - s + s * odds)))
    return min(s, largest)


def _log_sum(parts: Array) -> Array:
    top = parts.max(0)
    return top + np.log(np.exp(parts - top).sum(0))
