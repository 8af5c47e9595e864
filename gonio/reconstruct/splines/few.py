"""Of few samples, what the others say of each: base and patches both made without it.

With many samples a base of some fifty numbers does not notice one of them; with twenty it goes through them all, and
what they are missed by says nothing (Hastie, Tibshirani & Friedman 2009, 7.10.2, the wrong way to cross-validate).
"""

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.splines.frame import Coordinates
from gonio.reconstruct.splines.patches import Patches

FEW, FOLDS = 150, 10


def said_by_others(problem, stretch: Coordinates, rng: np.random.Generator) -> Array:
    """y (N, C) of every sample of a `Problem` as FOLDS fits without a tenth of them have it, over its own base."""
    n, make = len(problem.samples), type(problem).of
    fold = rng.permutation(n) % FOLDS
    said = np.empty_like(problem.y)
    for k in range(FOLDS):
        out = fold == k
        rest = make(problem.samples[~out], problem.frame, rng)
        a = problem.angles.at(out)
        y = Patches(stretch(rest.angles), rest.y, rest.variance)(stretch(a))
        said[out] = problem.ratio.forward(rest.ratio.inverse(y, rest.base(a)), problem.b[out])
    return said
