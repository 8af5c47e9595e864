"""Even over both hemispheres, one draw in each of about n cells of (cos theta_i, cos theta_o, phi)."""

import numpy as np

from gonio.bench.peers.session import Session, visible
from gonio.geometry import Array, from_height


def look(session: Session, n: int, rng: np.random.Generator) -> None:
    sides = round(n ** (1 / 3))
    wi, wo = cells(sides, rng)
    while np.count_nonzero(keep := visible(session, wi, wo)) < n:
        sides += 1
        wi, wo = cells(sides, rng)
    some = rng.permutation(np.flatnonzero(keep))[:n]
    session(wi[some], wo[some])


def cells(sides: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """One pair in each of sides^3 cells; the light's azimuth is 0."""
    at = np.stack(np.meshgrid(*3 * [np.arange(sides)], indexing="ij"), -1).reshape(-1, 3)
    u = (at + rng.random(at.shape)) / sides
    return from_height(u[:, 0], 0 * u[:, 0]), from_height(u[:, 1], 2 * np.pi * u[:, 2])
