"""The default plan: look first, then draw from a mixture of lobes that follows the material.

A pilot of about a hundred measurements gives the first mixture; it is refitted on a growing schedule from every draw
with its importance weight, all but the points where a chain now sits (METHOD 8). The fit is a maximum of weighted
likelihood over the *shares* of a fixed dictionary of lobes: a convex problem, solved by EM from any start, so that no
start decides where it ends. Cosine and uniform lobes keep a share: the weight stays bounded.

Lobes cannot follow every material (a flake coat, a film whose peak is off theta_h = 0). From a few hundred measurements
on the running reconstruction thins the mixture's draws (gonio.mcmc.proposals.screened) and screens the local moves
(delayed acceptance): what it knows to be hopeless or already well covered is settled without moving the rig.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.geometry import Array
from gonio.mcmc.proposals.independence import ELEVATIONS, EVEN, Dictionary, Mixture, even_in_angle
from gonio.mcmc.proposals.pss_ndf import PssNdf
from gonio.mcmc.proposals.screened import ScreenedIndependence, choose
from gonio.mcmc.target import Target

# of the draws, theta_i is even in angle: of a hemisphere 0.4 % lies within 5 degrees, too few for a reconstruction
IN_ANGLE = 0.1
DEFENSIVE = 0.025  # of the cosine and of the uniform lobe, each
PRIOR = 8.0  # effective samples that the even prior on the shares is worth
LOCAL_STEPS = 2  # after each block
ENOUGH = 150  # draws from which on the pilot's coarse quadrature is left out
MAX_FIT = 6000  # draws used for one fit
FIRST_SURROGATE = 150  # measurements before the first surrogate; then at every doubling
HELD_OUT = 4  # every fourth measurement is kept from the surrogate, to judge it by
FLOOR = 0.02  # of the median of f, added to the surrogate: what it wrongly holds for black is still visited


def isotropic_dictionary() -> Dictionary:
    alpha = np.geomspace(5e-4, 0.9, 18)
    return Dictionary(alpha, alpha)


def anisotropic_dictionary() -> Dictionary:
    alpha = np.geomspace(2e-3, 0.9, 9)
    x, y = np.meshgrid(alpha, alpha, indexing="ij")
    return Dictionary(x.ravel(), y.ravel())


class Auto:
    """Blocks of `block` independence draws, then a few local moves; see the module's text.

    fit_surrogate(wi, wo, f) -> Brdf makes the running reconstruction; without it the mixture is drawn from as it is.
    """

    learns = True

    def __init__(self, *, block: int, anisotropic: bool, adapt: bool = True, fit_surrogate: Callable | None = None):
        self.adapt, self.fits, self.fit_surrogate = adapt, 0, fit_surrogate
        self.dictionary = anisotropic_dictionary() if anisotropic else isotropic_dictionary()
        self.shares = np.full((len(ELEVATIONS), self.dictionary.lobes), 1 / self.dictionary.size)
        self.independence = ScreenedIndependence(Mixture(self.dictionary, self.shares))
        self.local = PssNdf(0.1, anisotropic=anisotropic, sigma=0.1, global_share=0.0)
        self.kernels = [(self.independence, block), *[(self.local, 1)] * LOCAL_STEPS]
        self.screen: Callable[[Array, Array], Array] | None = None
        self._seen: tuple[Array, ...] | None = None
        self._next_surrogate = FIRST_SURROGATE

    def learn(self, target: Target, wi: Array, wo: Array, f: Array, log_q: Array) -> None:
        """Refit shares, albedos, floor and surrogate."""
        if self.fits and not self.adapt:
            return
        known = np.flatnonzero(np.isfinite(log_q))
        if self.fits and len(known) > ENOUGH + 110:
            known = known[110:]  # the pilot came first
        known = known[-MAX_FIT:]
        if not (f[known] > 0).any():
            return
        target.rescale(f[known], wo[known, 2], log_q[known])
        log_w = target.log_prob(f[known], wi[known], wo[known]) - log_q[known]
        self._fit_density(wi[known], wo[known], log_w)
        self.fits += 1
        if self.fit_surrogate is not None and len(f) >= self._next_surrogate:
            self._next_surrogate = 2 * len(f)
            self._seen = (wi, wo, f, log_q)
            self._fit_screen()
        self._use(target)

    def _fit_density(self, wi: Array, wo: Array, log_w: Array) -> None:
        """What to draw from, by draws (N, 3) of log importance weights (N,)."""
        self.shares = leant(fit_shares(self.dictionary, wi, wo, log_w))

    def _densities(self) -> list[Any]:
        """What was learnt as densities to choose from, each with `log_prob` and `sample`; the most likely first."""
        return [Mixture(self.dictionary, self.shares)]

    def _fit_screen(self) -> None:
        assert self._seen is not None and self.fit_surrogate is not None
        wi, wo, f, _ = self._seen
        learnt = np.arange(len(f)) % HELD_OUT > 0
        brdf = self.fit_surrogate(wi[learnt], wo[learnt], f[learnt])
        floor = FLOOR * np.median(np.maximum(f, 0), axis=0) + 1e-12
        self.screen = None if brdf is None else lambda wi, wo: brdf.eval(wi, wo) + floor

    def _use(self, target: Target) -> None:
        mixtures = self._densities()
        self.independence.density, self.independence.screened = mixtures[0], None
        if (screen := self.screen) is not None and self._seen is not None:
            frozen = target.copy()
            wi, wo, f, log_q = self._seen
            unseen = (np.arange(len(f)) % HELD_OUT == 0) & np.isfinite(log_q)
            self.independence.density, self.independence.screened = choose(
                mixtures,
                lambda wi, wo: frozen.log_prob(screen(wi, wo), wi, wo) + log_lean(wi),
                wi[unseen],
                wo[unseen],
                target.log_prob(f[unseen], wi[unseen], wo[unseen]),
                log_q[unseen],
            )
        lobes = self.shares[:, :-2].sum(0)
        if lobes.sum() > 0:
            k = np.searchsorted(np.cumsum(lobes) / lobes.sum(), 0.5)
            self.local.alpha = float(np.sqrt(self.dictionary.alpha_x[k] * self.dictionary.alpha_y[k]))

    def state(self) -> dict[str, Any]:
        seen = None if self._seen is None else dict(zip(("wi", "wo", "f", "log_q"), self._seen))
        return {"shares": self.shares.copy(), "fits": self.fits, "next": self._next_surrogate, "seen": seen}

    def restore(self, state: dict[str, Any], target: Target) -> None:
        self.shares, self.fits, self._next_surrogate = np.array(state["shares"]), int(state["fits"]), int(state["next"])
        if state["seen"] is not None:
            seen = state["seen"]
            self._seen = tuple(np.array(seen[k]) for k in ("wi", "wo", "f", "log_q"))
            self._fit_screen()
        if self.fits:
            self._use(target)


def leant(shares: Array) -> Array:
    """The shares (J, K + 2) with IN_ANGLE of every lobe's draws given to the elevation that is even in the angle."""
    out = (1 - IN_ANGLE) * shares
    out[EVEN] += IN_ANGLE * shares.sum(0)
    return out


def log_lean(wi: Array) -> Array:
    """What the same does to a surrogate of the target, which thins the draws, (N,)."""
    return np.log(1 - IN_ANGLE + IN_ANGLE * even_in_angle(wi[:, 2]))


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
