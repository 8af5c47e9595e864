"""The grid of MERL (Matusik et al. 2003): (theta_h, theta_d, phi_d) as 1 : 1 : 2, theta_h even in its square root,
phi_d over half a turn by reciprocity. As many of its nodes as the rig reaches, about n; read linearly between them."""

import numpy as np

from gonio.bench.peers.session import Session, visible
from gonio.brdf import Brdf, Lambert
from gonio.geometry import Array, from_half_diff, to_half_diff

COSINE = Lambert([1.0])  # what is drawn by, where a peer says nothing of drawing


def look(session: Session, n: int, rng: np.random.Generator) -> None:
    nodes = largest(session, n)[0]
    session(*from_half_diff(nodes[:, 0], 0 * nodes[:, 0], nodes[:, 1], nodes[:, 2]))


def largest(session: Session, n: int) -> tuple[Array, tuple[int, int, int]]:
    """Nodes (N, 3) that the rig reaches, N <= n, of the finest grid that has no more; and that grid's sides."""
    found: tuple[Array, tuple[int, int, int]] = (np.zeros((0, 3)), (1, 1, 1))
    for side in range(2, 200):
        for sides in ((side, side, 2 * side - 1), (side + 1, side, 2 * side), (side + 1, side + 1, 2 * side)):
            nodes = grid(sides)
            wi, wo = from_half_diff(nodes[:, 0], 0 * nodes[:, 0], nodes[:, 1], nodes[:, 2])
            keep = visible(session, wi, wo)
            if np.count_nonzero(keep) > n:
                return found
            found = nodes[keep], sides
    return found


def grid(sides: tuple[int, int, int]) -> Array:
    """theta_h, theta_d, phi_d (N, 3) at the centres of cells."""
    h, d, p = ((np.arange(k) + 0.5) / k for k in sides)
    return np.stack(np.meshgrid(np.pi / 2 * h**2, np.pi / 2 * d, np.pi * p, indexing="ij"), -1).reshape(-1, 3)


def own(session: Session) -> Brdf:
    return GridBrdf(session, largest(session, session.measured)[1])


class GridBrdf:
    """f at the cells' centres, linear between them; a cell that was not measured has its nearest neighbour's."""

    def __init__(self, session: Session, sides: tuple[int, int, int]):
        from scipy.spatial import cKDTree

        s = session.samples
        self.channels, self.sides = session.channels, np.array(sides)
        self.sample, self.pdf = COSINE.sample, COSINE.pdf
        _, nearest = cKDTree(place(*half(s.wi, s.wo)) * sides).query(_square(grid(sides)) * sides)
        self.table = s.f[nearest].reshape(*sides, -1)

    def eval(self, wi: Array, wo: Array) -> Array:
        from scipy.ndimage import map_coordinates

        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        at = (place(*half(wi, wo)) * self.sides - 0.5).T
        # half a turn, then the same again
        pad = np.concatenate([self.table[:, :, -1:], self.table, self.table[:, :, :1]], 2)
        at[2] += 1
        out = np.stack([map_coordinates(pad[..., c], at, order=1, mode="nearest") for c in range(self.channels)], -1)
        return np.where(up[:, None], np.maximum(out, 0), 0)


def half(wi: Array, wo: Array) -> tuple[Array, Array, Array]:
    theta_h, _, theta_d, phi_d = to_half_diff(wi, wo)
    return theta_h, theta_d, phi_d % np.pi


def place(theta_h: Array, theta_d: Array, phi_d: Array) -> Array:
    """(N, 3) in [0, 1)."""
    return np.stack([np.sqrt(theta_h / (np.pi / 2)), theta_d / (np.pi / 2), phi_d / np.pi], -1)


def _square(nodes: Array) -> Array:
    return place(*nodes.T)
