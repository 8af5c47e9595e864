"""The thesis of 2024, exactly: a random walk in the primary sample space (3.3) that looks at one channel, its own
reconstruction (4.1-4.3)."""

import numpy as np

from gonio.bench.peers.ours import by_sampler
from gonio.bench.peers.session import Session
from gonio.brdf import Brdf
from gonio.reconstruct import reconstruct


def look(session: Session, n: int, rng: np.random.Generator) -> None:
    by_sampler(session, n, "thesis")


def own(session: Session) -> Brdf:
    return reconstruct(session.samples, "thesis")
