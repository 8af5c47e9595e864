"""The chain of before: its target is the reflected energy, f cos theta_o."""

import numpy as np

from gonio.bench.peers.ours import by_sampler
from gonio.bench.peers.session import Session


def look(session: Session, n: int, rng: np.random.Generator) -> None:
    by_sampler(session, n, {"target": {"kind": "energy"}})
