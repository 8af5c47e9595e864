"""How high the surface itself stands around each of its points: rays marched over the heights, once for all light.

A direction is seen from a point where its elevation is above the horizon of its azimuth (horizon mapping, Max 1988).
"""

import numpy as np
from scipy.ndimage import map_coordinates

from gonio.geometry import Array

AZIMUTHS = 48
FIRST, STEP = 1.0, 1.06  # of the march, in cells: even near by, wider with the distance
FARTHEST = 2.0  # periods


def horizons(height: Array, points: Array) -> Array:
    """Slopes (P, AZIMUTHS), tan of the horizon's elevation at grid points (P, 2), azimuths 2 pi k / AZIMUTHS."""
    n = len(height)
    own = height[points[:, 0], points[:, 1]]
    highest = np.full((len(points), AZIMUTHS), -np.inf)
    steps = [FIRST]
    while steps[-1] < FARTHEST * n and (height.max() - height.min()) / steps[-1] > 1e-3:
        steps.append(max(steps[-1] + 0.5, steps[-1] * STEP))
    for k in range(AZIMUTHS):
        phi = 2 * np.pi * k / AZIMUTHS
        direction = np.array([np.cos(phi), np.sin(phi)])
        for s in steps:
            at = points + s * direction
            there = map_coordinates(height, at.T % n, order=1, mode="grid-wrap")
            np.maximum(highest[:, k], (there - own) / s, out=highest[:, k])
    return highest
