"""Where on a BRDF a pair lies: peak, flank, floor, grazing; uncertainties are told apart by it."""

import numpy as np
from numpy.typing import NDArray

from gonio.brdf import Brdf
from gonio.brdf.models.lambert import cosine_hemisphere
from gonio.geometry import Array, from_angles, to_angles

STRATA = ("peak", "flank", "floor", "grazing")
PEAK, FLANK = 0.5, 0.05  # of the largest f at that theta_i
GRAZING = np.radians(75.0)
BINS = 12


def strata(brdf: Brdf, wi: Array, wo: Array) -> NDArray[np.int64]:
    """Which of STRATA (N,) each pair belongs to, by the mean of its channels."""
    theta_i, theta_o = to_angles(wi)[0], to_angles(wo)[0]
    top = np.interp(theta_i, *_tops(brdf))
    share = brdf.eval(wi, wo).mean(1) / np.maximum(top, 1e-300)
    which = np.where(share > PEAK, 0, np.where(share > FLANK, 1, 2))
    return np.asarray(np.where(np.maximum(theta_i, theta_o) > GRAZING, 3, which))


def _tops(brdf: Brdf) -> tuple[Array, Array]:
    """The largest f over wo below GRAZING, by theta_i: draws of the BRDF itself, and even ones."""
    angles = np.linspace(0.01, GRAZING, BINS)
    u = (np.arange(512)[:, None] * [0.754877666, 0.569840291] + 0.5) % 1.0  # an additive recurrence in two dimensions
    tops = []
    for angle in angles:
        wi = np.broadcast_to(from_angles(angle, 0.0), (len(u), 3))
        wo = np.concatenate([brdf.sample(wi, u)[0], cosine_hemisphere(u), wi * [-1, -1, 1]])
        f = brdf.eval(np.broadcast_to(wi[:1], wo.shape), wo).mean(1)
        tops.append(f[(wo[:, 2] > np.cos(GRAZING))].max(initial=1e-300))
    return angles, np.array(tops)
