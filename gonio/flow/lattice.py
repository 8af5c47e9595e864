"""What a coupling's network says of coordinates that float32 holds only nearly.

Networks are float32, so they are shown the nearest point of a lattice that float32 holds exactly. A coordinate halfway
between two such points may be rounded to one on the way to the base and to the other on the way back, by 1e-16 of
noise, and the warps of neighbours differ by 1e-8. So across the halfway line the numbers are led over without a step.
"""

import numpy as np

from gonio.flow import encoding
from gonio.flow.coupling import Coupling
from gonio.geometry import Array

FINENESS = 2.0**23  # points in [0, 1]; 2x - 1 of them is exact in float32
NEAR = 2e-4  # of a lattice step to either side of the halfway line: much more than rounding, and rare


def numbers(c: Coupling, kind: str, y: Array) -> Array:
    """Numbers for the warp of coupling `c`, (outputs, N), where the coordinates given to it are y (N, given)."""
    exact = y * FINENESS
    node = np.rint(exact)
    raw = c.network(encoding.features(kind, node / FINENESS, c.periodic))
    beyond = np.abs(exact - node) - (0.5 - NEAR)
    for i in np.flatnonzero((beyond > 0).any(1)):
        # the same two points, in the same order, from either side of the line: so the same numbers to the bit
        low = np.where(beyond[i] > 0, np.floor(exact[i]), node[i])
        two = np.stack([low, low + (beyond[i] > 0)]) / FINENESS
        middle = c.network(encoding.features(kind, two, c.periodic)).mean(1)
        raw[:, i] += beyond[i].max() / NEAR * (middle - raw[:, i])
    return raw
