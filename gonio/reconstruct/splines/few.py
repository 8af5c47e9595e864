"""Of few samples, what the others say of each: base and patches both made without it.

With many samples a base of some fifty numbers does not notice one of them; with twenty it goes through them all, and
what they are missed by says nothing (Hastie, Tibshirani & Friedman 2009, 7.10.2, the wrong way to cross-validate).
"""

from collections.abc import Callable

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.splines.frame import Coordinates
from gonio.reconstruct.splines.patches import Patches, relative_variance

FEW, FOLDS = 150, 10
FEWEST = 50  # below: too few to tell a wrong reading from a peak, a tilt from chance, or to choose among many widths


def said_by_others(
    problem, stretch: Coordinates, rng: np.random.Generator, mirrored: Callable | None = None
) -> tuple[Array, Array]:
    """y (N, C) of every sample of a `Problem` as FOLDS fits without a tenth of them have it, over its own base, and
    the relative variances (N,) of those predictions.

    mirrored(problem, stretch) -> x, y, variance, … of more samples that each fit may use: images of its own.
    """
    n, make = len(problem.samples), type(problem).of
    fold = rng.permutation(n) % FOLDS
    said, relative = np.empty_like(problem.y), np.empty(n)
    for k in range(FOLDS):
        out = fold == k
        rest = make(problem.samples[~out], problem.frame, rng, problem.base.weight)
        a = problem.angles.at(out)
        x, y, variance = stretch(rest.angles), rest.y, rest.variance
        if mirrored is not None:
            x, y, variance = (np.concatenate(pair) for pair in zip((x, y, variance), mirrored(rest, stretch)))
        relative[out] = relative_variance(x, y, variance, stretch(a))
        y = Patches(x, y, variance)(stretch(a))
        said[out] = problem.ratio.forward(rest.ratio.inverse(y, rest.base(a)), problem.b[out])
    return said, relative
