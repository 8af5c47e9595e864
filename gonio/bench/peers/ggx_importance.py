"""Importance sampling without a chain: one GGX lobe fitted to the first look, theta_i even in angle, a quarter cosine.

The first look is gonio's own pilot, 24 directions.
"""

import numpy as np

from gonio.bench.peers.session import Session, visible
from gonio.brdf import Brdf, Ggx
from gonio.geometry import Array, from_angles, from_height
from gonio.mcmc.plans.unknown import PILOT, first_directions
from gonio.reconstruct import reconstruct
from gonio.reconstruct.fits.ggx import fit

COSINE = 0.25


def look(session: Session, n: int, rng: np.random.Generator) -> None:
    wi, wo, _ = first_directions(False)
    keep = visible(session, wi, wo)
    session(wi[keep][: min(PILOT, n)], wo[keep][: min(PILOT, n)])
    if (left := n - session.measured) <= 0:
        return
    fitted = fit(session.samples, anisotropic=False, rng=rng)
    lobe = Ggx(fitted.ndf.alpha_x, None, [1.0])
    wi, wo = draws(lobe, 8 * left, rng)
    keep = visible(session, wi, wo)
    session(wi[keep][:left], wo[keep][:left])


def draws(lobe: Brdf, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """wi, wo (count, 3); some of wo below the horizon."""
    wi = from_angles(np.pi / 2 * rng.random(count), np.zeros(count))
    wo, _ = lobe.sample(wi, rng.random((count, 2)))
    cosine = from_height(np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count))
    return wi, np.where((rng.random(count) < COSINE)[:, None], cosine, wo)


def own(session: Session) -> Brdf:
    return reconstruct(session.samples, "ggx")
