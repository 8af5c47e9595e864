"""What a step past the edge of the unit interval means. Both rules keep the step symmetric."""

import numpy as np

from gonio.geometry import Array


def wrap(u: Array) -> Array:
    """Periodic: right for an azimuth of full period. On theta_h it sends the peak to the horizon (thesis 6.1.1)."""
    return u - np.floor(u)


def reflect(u: Array) -> Array:
    """Mirrored at 0 and 1, as often as needed."""
    return np.abs(u - 2 * np.rint(0.5 * u))
