"""Nielsen, Jensen & Ramamoorthi 2015 ("On optimal, minimal BRDF sampling for reflectance acquisition").

Principal components of ln((f w + e) / (f0 w + e)), f0 the median material, w = cos theta_i cos theta_o, e = 1e-3, of
known materials, a channel each a material of its own; the directions that tell most of the components; coefficients by
ridge regression. Their materials are MERL's; here they are the networks of `archive`, without the one that is measured
and its kin. They choose directions by gradient descent on the condition number from many starts; here they are chosen
greedily, each to make the determinant largest (D-optimal), which the rig's reach allows to ask.
"""

import os
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from gonio.bench.accuracy.prior import kin
from gonio.bench.drive import truth_of
from gonio.bench.flows.pretrain import names_of
from gonio.bench.peers.merl_grid import COSINE
from gonio.bench.peers.session import Session, visible
from gonio.brdf import Brdf
from gonio.geometry import Array, from_half_diff
from gonio.reconstruct.prior.materials import NODES, chart, nodes
from gonio.reconstruct.splines.robust_base import Angles
from gonio.reconstruct.tables.lookup import Lookup

E = 1e-3
COMPONENTS = 30
RIDGE = 40.0  # theirs, of coefficients of norm 1 over all materials


def look(session: Session, n: int, rng: np.random.Generator) -> None:
    known = Known.of(kin(session.material))
    wi, wo = _pairs()
    there = np.flatnonzero(visible(session, wi, wo))
    chosen = there[telling(known.components[:, there].T, n, RIDGE / known.count)]
    session(wi[chosen], wo[chosen])
    session.notes["pca"] = known


def own(session: Session) -> Brdf:
    s, known = session.samples, session.notes["pca"]
    at = np.stack(known.at(s.wi, s.wo, known.components), 1)
    reference, w = known.at(s.wi, s.wo, known.reference[None])[0], weight(s.wi, s.wo)
    y = np.log((np.maximum(s.f, 0) * w[:, None] + E) / (reference * w + E)[:, None])
    y -= known.at(s.wi, s.wo, known.mean[None])[0][:, None]
    normal = at.T @ at + RIDGE / known.count * np.eye(at.shape[1])
    z = np.linalg.solve(normal, at.T @ y)
    return PcaBrdf(known, known.mean[:, None] + known.components.T @ z)


def telling(rows: Array, n: int, ridge: float) -> Array:
    """Numbers of n rows (N, K), each the one that adds most to the determinant of ridge + sum of r r^T."""
    inverse = np.eye(rows.shape[1]) / ridge
    left = np.ones(len(rows), bool)
    chosen = []
    for _ in range(min(n, len(rows))):
        gain = np.einsum("nk,kl,nl->n", rows, inverse, rows)
        k = int(np.argmax(np.where(left, gain, -1)))
        v = inverse @ rows[k]
        inverse -= np.outer(v, v) / (1 + rows[k] @ v)
        left[k] = False
        chosen.append(k)
    return np.array(chosen)


@dataclass(frozen=True)
class Known:
    """Materials: mean (n,), components (K, n) as long as their standard deviation, reference f (n,), at the nodes of
    the prior's chart; count of materials."""

    mean: Array
    components: Array
    reference: Array
    count: int

    @classmethod
    @lru_cache(maxsize=4)
    def of(cls, without: str) -> "Known":
        """Of all networks but those of a family."""
        f = np.concatenate([v for name, v in _values().items() if kin(name) != without])
        w = weight(*_pairs())
        reference = np.median(f, 0)
        logs = np.log((f * w + E) / (reference * w + E))
        mean = logs.mean(0)
        _, length, rows = np.linalg.svd(logs - mean, full_matrices=False)
        return cls(mean, (length[:, None] * rows / np.sqrt(len(logs)))[:COMPONENTS], reference, len(logs))

    def at(self, wi: Array, wo: Array, tables: Array) -> list[Array]:
        """Each of tables (K, n) at pairs, (N,)."""
        place = chart(Angles.of(wi, wo))
        return list(Lookup(tables.T.reshape(*NODES, -1), (False,) * 3, (1, 1, 1))(place).T)


class PcaBrdf:
    """table (n, C) of the logarithm."""

    def __init__(self, known: Known, table: Array):
        self.known, self.table, self.channels = known, table, table.shape[1]
        self.sample, self.pdf = COSINE.sample, COSINE.pdf

    def eval(self, wi: Array, wo: Array) -> Array:
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        w = weight(wi, wo)
        found = np.stack(self.known.at(wi, wo, np.concatenate([self.known.reference[None], self.table.T])), 1)
        f = (np.exp(np.minimum(found[:, 1:], 50)) * (found[:, :1] * w[:, None] + E) - E) / w[:, None]
        return np.where(up[:, None], np.maximum(f, 0), 0)


def weight(wi: Array, wo: Array) -> Array:
    return np.maximum(wi[:, 2] * wo[:, 2], E)


def archive() -> Path:
    """The file of networks, beside the tables of GONIO_MATERIALS."""
    return Path(os.environ.get("GONIO_MATERIALS", "../shared/materials/rgl")).parent / "nbrdf" / "nbrdf.npz"


def _pairs() -> tuple[Array, Array]:
    theta_h, theta_d, phi_d = nodes()
    return from_half_diff(theta_h, 0 * theta_h, theta_d, phi_d)


@lru_cache(maxsize=1)
def _values() -> dict[str, Array]:
    """f (C, n) of every network at the nodes."""
    wi, wo = _pairs()
    path = archive()
    return {name: truth_of(f"{path}:{name}").eval(wi, wo).T for name in names_of(str(path))}
