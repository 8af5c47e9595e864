"""Independence proposals from an explicit mixture: GGX lobes by their visible normals, a cosine lobe, a uniform one.

q(wi, wo) = sum_jk p_jk m_j(wi) l_k(wo | wi), every density known in closed form, so that the ratio of importance
weights is exact. m_j are densities of cos theta_i on the hemisphere that lean to the normal or to the horizon, or are
even in the angle; l_k the lobes. Its weight is bounded as long as the cosine and uniform lobes keep a share. The
proposals do not depend on where the chain is: a block of them may be measured in any order (Jacob, Robert & Smith
2011).
"""

from dataclasses import dataclass

import numpy as np

from gonio.brdf.models.ndf import GgxNdf
from gonio.geometry import Array, reflect
from gonio.mcmc.proposals.ggx_density import log_vndf

PI = np.pi
STEEPEST = 1e-9  # of 1 - mu: where the density that is even in theta_i is cut, at a ten-thousandth of a degree


def even_in_angle(mu: Array) -> Array:
    """2 / (pi sin theta_i), the density of mu = cos theta_i for theta_i uniform on (0, pi/2); finite at the normal."""
    return 2 / (PI * np.sqrt((1 + mu) * np.maximum(1 - mu, STEEPEST)))


# densities of mu = cos theta_i on (0, 1) and the inverses of their cumulatives
ELEVATIONS = (
    (lambda mu: np.ones_like(mu), lambda u: 1 - u),
    (lambda mu: 2 * mu, lambda u: np.sqrt(1 - u)),
    (lambda mu: 2 * (1 - mu), lambda u: 1 - np.sqrt(u)),
    (lambda mu: 4 * (1 - mu) ** 3, lambda u: 1 - u**0.25),
    (even_in_angle, lambda u: np.cos(PI / 2 * u)),
)
EVEN = len(ELEVATIONS) - 1


@dataclass(frozen=True)
class Dictionary:
    """The lobes a mixture may use: K GGX ones by (alpha_x, alpha_y), then a cosine and a uniform; times elevations."""

    alpha_x: Array
    alpha_y: Array

    @property
    def lobes(self) -> int:
        return len(self.alpha_x) + 2

    @property
    def size(self) -> int:
        return self.lobes * len(ELEVATIONS)

    def log_densities(self, wi: Array, wo: Array) -> tuple[Array, Array]:
        """log m_j(wi) (N, J) and log l_k(wo | wi) (N, K + 2), solid angles; valid above the horizon."""
        mu = wi[:, 2]
        with np.errstate(divide="ignore"):
            elevation = np.log(np.stack([m(mu) for m, _ in ELEVATIONS], -1) / (2 * PI))
            cosine = np.log(wo[:, 2:3] / PI)
        uniform = np.full((len(wi), 1), -np.log(2 * PI))
        return elevation, np.concatenate([log_vndf(wi, wo, self.alpha_x, self.alpha_y), cosine, uniform], 1)


class Mixture:
    """Shares p (J, K + 2) of a dictionary's products; density and draws."""

    def __init__(self, dictionary: Dictionary, shares: Array):
        self.dictionary, self.shares = dictionary, shares / shares.sum()
        self._cumulative = np.cumsum(self.shares.ravel())
        self._used = np.flatnonzero(self.shares.sum(0) > 0)
        d = dictionary
        kept = [k for k in self._used if k < len(d.alpha_x)]
        # only the lobes in use are evaluated
        self._small = Dictionary(d.alpha_x[kept], d.alpha_y[kept])
        columns = [*kept, d.lobes - 2, d.lobes - 1]
        with np.errstate(divide="ignore"):
            self._log_shares = np.log(self.shares[:, columns])

    def log_prob(self, wi: Array, wo: Array) -> Array:
        """log q (N,), solid angles; both directions above the horizon."""
        elevation, lobe = self._small.log_densities(wi, wo)
        # sum over elevations inside the exponent of each lobe: (N, J, K) is avoided
        with np.errstate(divide="ignore"):
            inner = np.log(np.exp(elevation) @ np.exp(self._log_shares))
        total = inner + lobe
        top = total.max(1)
        return top + np.log(np.exp(total - top[:, None]).sum(1))

    def sample(self, uniform: Array) -> tuple[Array, Array]:
        """wi, wo (N, 3) from uniform (5, N); wo may fall below the horizon."""
        n, d = uniform.shape[1], self.dictionary
        pick = np.minimum(np.searchsorted(self._cumulative, uniform[0], "right"), d.size - 1)
        j, k = np.divmod(pick, d.lobes)
        mu = np.empty(n)
        for i, (_, inverse) in enumerate(ELEVATIONS):
            mine = j == i
            mu[mine] = inverse(uniform[1, mine])
        r, phi = np.sqrt((1 - mu) * (1 + mu)), 2 * PI * uniform[2]
        wi = np.stack([r * np.cos(phi), r * np.sin(phi), mu], -1)
        wo = np.empty((n, 3))
        u = uniform[3:].T
        for i in np.unique(k):
            mine = k == i
            if i < len(d.alpha_x):
                h = GgxNdf(d.alpha_x[i], d.alpha_y[i]).sample(wi[mine], u[mine])
                wo[mine] = reflect(wi[mine], h)
            else:
                z = np.sqrt(1 - u[mine, 0]) if i == len(d.alpha_x) else 1 - u[mine, 0]
                s, azimuth = np.sqrt((1 - z) * (1 + z)), 2 * PI * u[mine, 1]
                wo[mine] = np.stack([s * np.cos(azimuth), s * np.sin(azimuth), z], -1)
        return wi, wo


class Independence:
    """Blocks of draws from a density that does not depend on the chains' states."""

    uniforms, normals = 5, 0

    def __init__(self, density: Mixture):
        self.density = density

    def draw_block(self, uniform: Array) -> tuple[Array, Array, Array, Array]:
        """u, wi, wo, log_jacobian of block x chains draws, from uniform (block, uniforms, chains)."""
        wi, wo = self.density.sample(side_by_side(uniform))
        u = np.concatenate([wi.T, wo.T])
        return u, wi, wo, self.log_jacobian(u)

    def from_directions(self, wi: Array, wo: Array) -> Array:
        return np.concatenate([wi.T, wo.T])

    def to_directions(self, u: Array) -> tuple[Array, Array]:
        return u[:3].T, u[3:].T

    def log_jacobian(self, u: Array) -> Array:
        """-log q: the weight of a state then is its importance weight."""
        out = np.full(u.shape[1], -np.inf)
        above = (u[2] > 0) & (u[5] > 0)
        out[above] = -self.density.log_prob(u[:3, above].T, u[3:, above].T)
        return out


def side_by_side(uniform: Array) -> Array:
    """(block, k, chains) -> (k, block x chains), the draws of one step of all chains next to each other."""
    return uniform.transpose(1, 0, 2).reshape(uniform.shape[1], -1)


def single_lobe(alpha_x: float, alpha_y: float) -> Mixture:
    """80 % one GGX lobe, 15 % cosine, 5 % uniform, wi uniform: what METHOD 8 measured."""
    shares = np.zeros((len(ELEVATIONS), 3))
    shares[0] = 0.8, 0.15, 0.05
    return Mixture(Dictionary(np.array([alpha_x]), np.array([alpha_y])), shares)
