"""Doubling by reciprocity, f(wi, wo) = f(wo, wi): a hypothesis about measured data, so the data are asked first.

Every sample is also one of its mirror image, wi and wo exchanged. Held-out samples are predicted from the others, and
from the others with their mirror images; the images are kept if they make the energy error smaller. Real tables break
reciprocity by 2 to 40 % and are better off without; networks and analytic models are reciprocal and gain a quarter.
"""

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.splines.few import FEW, said_by_others
from gonio.reconstruct.splines.held_out import EnergyError
from gonio.reconstruct.splines.patches import left_out

TESTED = 600
LOWEST = 0.05
GAIN = 0.97


def mirrored(p, stretch) -> tuple[Array, Array, Array, Array]:
    """x, y, variance of the mirror images of the problem's samples, and whose they are (indices)."""
    s = p.samples
    who = np.flatnonzero((s.wi[:, 2] > LOWEST) & (s.wo[:, 2] > LOWEST))
    a = p.frame.angles(s.wo[who], s.wi[who])
    g, sigma = s.f[who] * a.cos_o[:, None], s.sigma[who] * a.cos_o[:, None]
    b = p.base(a)
    return stretch(a), p.ratio.forward(g, b), p.ratio.variance(g, sigma, b), who


def holds(p, stretch, rng: np.random.Generator) -> tuple[bool, float]:
    """Whether to use the images, and the energy error with them over that without."""
    n = len(p.samples)
    if n <= FEW:
        return _holds_of_few(p, stretch, rng)
    test = rng.permutation(n)[: min(TESTED, n // 4)]
    x = stretch(p.angles)
    more_x, more_y, more_variance, who = mirrored(p, stretch)
    # the image of a held-out sample would give it away
    others = ~np.isin(who, test)
    error = EnergyError(p.angles, p.g, p.sigma, stretch, test)
    alone = error(p.ratio.inverse(left_out(x, p.y, p.variance, test), p.b[test]))
    both = left_out(
        np.concatenate([x, more_x[others]]),
        np.concatenate([p.y, more_y[others]]),
        np.concatenate([p.variance, more_variance[others]]),
        test,
    )
    ratio = error(p.ratio.inverse(both, p.b[test])) / max(alone, 1e-12)
    return ratio < GAIN, ratio


def _holds_of_few(p, stretch, rng: np.random.Generator) -> tuple[bool, float]:
    """The same of few samples: all of them are held out, a tenth at a time, with their images."""
    every = np.arange(len(p.samples))
    error = EnergyError(p.angles, p.g, p.sigma, stretch, every)
    seed = int(rng.integers(2**63))
    alone, both = (
        error(p.ratio.inverse(said_by_others(p, stretch, np.random.default_rng(seed), images)[0], p.b))
        for images in (None, mirrored)
    )
    ratio = both / max(alone, 1e-12)
    return ratio < 1, ratio
