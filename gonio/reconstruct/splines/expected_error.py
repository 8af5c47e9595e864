"""The energy error to be expected, over the whole domain and not only where samples are.

    E = mean over theta_i and channels of  integral <|f^ - f|> cos(theta_o) dwo / integral f^ cos(theta_o) dwo

by the referee's own quadrature; <|f^ - f|> from the posterior's interval of 68 %: its half width times MEAN_OVER_68,
which lies between the 0.80 of a normal variable and the 1 of one with long tails.
"""

from collections.abc import Callable

import numpy as np

from gonio.evaluate import directions
from gonio.geometry import Array

MEAN_OVER_68 = 0.9
POINTS = 1500  # of the quadrature, per incidence


def expected_error(
    evaluate: Callable[[Array, Array], Array], interval: Callable[[Array, Array], tuple[Array, Array]], n: int = POINTS
) -> float:
    """evaluate(wi, wo) -> f^ (N, C); interval(wi, wo) -> its 68 % interval, low and high (N, C)."""
    errors = []
    for wi, wo, weight, _ in directions(n):
        w = (weight * wo[:, 2])[:, None]
        low, high = interval(wi, wo)
        total = np.maximum((evaluate(wi, wo) * w).sum(0), 1e-300)
        errors.append((MEAN_OVER_68 * 0.5 * (high - low) * w).sum(0) / total)
    return float(np.mean(errors))
