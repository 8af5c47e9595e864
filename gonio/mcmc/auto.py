"""The default plan: look first, then draw from a mixture of lobes that follows the material.

A pilot of about a hundred measurements gives the first mixture; it is refitted on a growing schedule from every draw
with its importance weight, all but the points where a chain now sits (METHOD 8). The fit is a maximum of weighted
likelihood over the *shares* of a fixed dictionary of lobes: a convex problem, solved by EM from any start, so that no
start decides where it ends. Cosine and uniform lobes keep a share: the weight stays bounded.
"""

from typing import Any

import numpy as np

from gonio.geometry import Array
from gonio.mcmc.proposals.independence import ELEVATIONS, Dictionary, Independence, Mixture
from gonio.mcmc.proposals.pss_ndf import PssNdf
from gonio.mcmc.target import Target

DEFENSIVE = 0.025  # of the cosine and of the uniform lobe, each
PRIOR = 8.0  # effective samples that the even prior on the shares is worth
LOCAL_STEPS = 2  # after each block
ENOUGH = 150  # draws from which on the pilot's coarse quadrature is left out
MAX_FIT = 6000  # draws used for one fit


def isotropic_dictionary() -> Dictionary:
    alpha = np.geomspace(5e-4, 0.9, 18)
    return Dictionary(alpha, alpha)


def anisotropic_dictionary() -> Dictionary:
    alpha = np.geomspace(2e-3, 0.9, 9)
    x, y = np.meshgrid(alpha, alpha, indexing="ij")
    return Dictionary(x.ravel(), y.ravel())


class Auto:
    """Blocks of `block` independence draws, then a few local moves; see the module's text."""

    screen = None

    def __init__(self, *, block: int, anisotropic: bool, adapt: bool = True):
        self.learns, self.adapt, self.fits = True, adapt, 0
        self.dictionary = anisotropic_dictionary() if anisotropic else isotropic_dictionary()
        self.shares = np.full((len(ELEVATIONS), self.dictionary.lobes), 1 / self.dictionary.size)
        self.independence = Independence(Mixture(self.dictionary, self.shares))
        self.local = PssNdf(0.1, anisotropic=anisotropic, sigma=0.1, global_share=0.0)
        self.kernels = [(self.independence, block), *[(self.local, 1)] * LOCAL_STEPS]

    def learn(self, target: Target, wi: Array, wo: Array, f: Array, log_q: Array) -> None:
        """Refit shares, albedos and floor from draws of known density."""
        if self.fits and not self.adapt:
            return
        known = np.flatnonzero(np.isfinite(log_q))
        if self.fits and len(known) > ENOUGH + 110:
            known = known[110:]  # the pilot came first
        known = known[-MAX_FIT:]
        wi, wo, f, log_q = wi[known], wo[known], f[known], log_q[known]
        if not (f > 0).any():
            return
        target.rescale(f, wo[:, 2], log_q)
        log_w = target.log_prob(f, wo[:, 2]) - log_q
        self.shares = fit_shares(self.dictionary, wi, wo, log_w)
        self.fits += 1
        self._use(self.shares)

    def _use(self, shares: Array) -> None:
        self.independence.density = Mixture(self.dictionary, shares)
        lobes = shares[:, :-2].sum(0)
        if lobes.sum() > 0:
            k = np.searchsorted(np.cumsum(lobes) / lobes.sum(), 0.5)
            self.local.alpha = float(np.sqrt(self.dictionary.alpha_x[k] * self.dictionary.alpha_y[k]))

    def state(self) -> dict[str, Any]:
        return {"shares": self.shares.copy(), "fits": self.fits}

    def restore(self, state: dict[str, Any]) -> None:
        self.shares, self.fits = np.array(state["shares"]), int(state["fits"])
        if self.fits:
            self._use(self.shares)


def fit_shares(dictionary: Dictionary, wi: Array, wo: Array, log_w: Array) -> Array:
    """Shares (J, K + 2) that maximise the weighted likelihood, with a little of the even prior, pruned and defended."""
    w = np.exp(log_w - log_w.max())
    w /= w.sum()
    effective = 1 / np.sum(w * w)
    top = np.argsort(w)[-MAX_FIT:]
    used = top[w[top] > 1e-7 * w.max()]
    elevation, lobe = dictionary.log_densities(wi[used], wo[used])
    lobe = np.exp(lobe - lobe.max(1, keepdims=True))
    elevation = np.exp(elevation)
    weight = w[used]
    even = np.full((elevation.shape[1], lobe.shape[1]), 1 / dictionary.size)
    p = even.copy()
    for _ in range(80):
        # responsibilities summed over samples, without the (N, J, K) array
        total = np.einsum("nj,jk,nk->n", elevation, p, lobe, optimize=True)
        p = p * np.einsum("nj,n,nk->jk", elevation, weight / total, lobe, optimize=True)
        p = (effective * p / p.sum() + PRIOR * even) / (effective + PRIOR)
    p[p < 1e-3] = 0
    p *= (1 - 2 * DEFENSIVE) / p.sum()
    p[0, -2] += DEFENSIVE
    p[0, -1] += DEFENSIVE
    return p
