"""gonio as it ships: a chain whose target is what the reconstruction does not know yet."""

import numpy as np

from gonio.bench.drive import surrogate
from gonio.bench.peers.session import Session
from gonio.brdf import Brdf
from gonio.config import Material
from gonio.geometry import Array
from gonio.mcmc import make_sampler


def look(session: Session, n: int, rng: np.random.Generator) -> None:
    by_sampler(session, n, {})


def by_sampler(session: Session, n: int, sampler: dict | str) -> None:
    """n measurements that a `sampler` section asks for."""
    section = {"sampler": sampler, "budget": {"measurements": n}}
    material = Material.model_validate({"name": "x", "channels": session.channels, "seed": session.seed, **section})
    known: list[Brdf] = []

    def fit(wi: Array, wo: Array, f: Array, sigma: Array | None = None) -> Brdf:
        known[:] = [surrogate(wi, wo, f, sigma)]
        return known[0]

    chain = make_sampler(material, session.reachable, fit, (n,))
    while session.measured < n:
        batch = chain.ask()
        ids = batch.ids[: n - session.measured]
        read = session(batch.wi[: len(ids)], batch.wo[: len(ids)], known[0].eval if known else None)
        chain.tell(ids, read.f, read.sigma)
        chain.take_steps()
