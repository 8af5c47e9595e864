"""A fixed list that knows nothing: a scrambled Sobol sequence in (theta_h = pi/2 u^2, theta_d, phi_d), one tour."""

import numpy as np

from gonio.bench.peers.session import Session, visible
from gonio.geometry import Array, from_half_diff


def look(session: Session, n: int, rng: np.random.Generator) -> None:
    wi, wo = points(4 * n, rng)
    keep = visible(session, wi, wo)
    session(wi[keep][:n], wo[keep][:n])


def points(count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """wi, wo of at least `count` points of the sequence."""
    from scipy.stats import qmc

    u = qmc.Sobol(3, seed=rng).random(2 ** int(np.ceil(np.log2(count))))
    return from_half_diff(np.pi / 2 * u[:, 0] ** 2, 0 * u[:, 0], np.pi / 2 * u[:, 1], 2 * np.pi * u[:, 2])
