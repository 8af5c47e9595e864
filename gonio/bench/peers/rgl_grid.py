"""The adaptive grid of Dupuy & Jakob 2018 ("An adaptive parameterization for efficient material acquisition").

First the retro-reflection, whose power iteration gives the normals D (their 4.1; Dupuy et al. 2015); then 8 incidences,
those of their published tables, of k x k directions each, even in the square that D's visible normals warp to. Read
back as their tables are. Retro-reflection itself is in the detector's shadow: the nearest that the rig reaches stands
for it.
"""

import numpy as np

from gonio.bench.peers.session import Session, visible
from gonio.brdf import Brdf, RglBrdf
from gonio.brdf.tables.warp import Warp
from gonio.export.profile import projected_area
from gonio.geometry import Array, from_angles, from_half_diff, reflect, unit

THETA_I = np.radians([0.0, 29.617508, 42.529285, 52.93749, 62.232117, 71.023346, 79.7585, 89.99999])
COLUMNS, ROWS = 128, 65  # of the tables of D and of the warp
ITERATIONS = 24


def look(session: Session, n: int, rng: np.random.Generator) -> None:
    retro = max(8, min(90, n // 24))
    theta = np.pi / 2 * ((np.arange(retro) + 0.5) / retro) ** 2  # close together where lobes are
    wi, wo = nearest_retro(session, theta)
    keep = visible(session, wi, wo)
    read = session(wi[keep], wo[keep])
    plan = Adaptive(theta[keep], np.maximum(read.f.mean(1), 0))
    left = n - session.measured
    chosen = plan.slices(2)
    for sides in range(3, 500):
        wi, wo = plan.slices(sides)
        if np.count_nonzero(visible(session, wi, wo)) > left:
            break
        chosen = wi, wo
    wi, wo = chosen
    up = visible(session, wi, wo)
    plan.values = np.full((len(wi), session.channels), np.nan)
    plan.values[up] = session(wi[up], wo[up]).f
    session.notes["rgl"] = plan


def own(session: Session) -> Brdf:
    return session.notes["rgl"].table()


def nearest_retro(session: Session, theta: Array) -> tuple[Array, Array]:
    """wi, wo (N, 3) about half vectors of elevations theta, as near to each other as the rig reaches: apart across the
    plane of theta, so that both have about its elevation."""
    found = np.zeros(len(theta), bool)
    wi = wo = from_angles(theta, 0 * theta)
    for apart in np.radians(np.arange(0, 12, 0.25)):
        pair = from_half_diff(theta, 0 * theta, np.full(len(theta), apart / 2), np.full(len(theta), np.pi / 2))
        take = ~found & visible(session, *pair)
        wi, wo = (np.where(take[:, None], new, old) for new, old in zip(pair, (wi, wo)))
        found |= take
    return wi, wo


class Adaptive:
    """The square of half vectors as the retro-reflection f (N,) at elevations theta (N,) has it stretched.

    `values` (8 k k, C) are readings at the nodes of `slices(k)`, NaN where there are none.
    """

    def __init__(self, theta: Array, f: Array):
        x = np.linspace(0, 1, COLUMNS)
        # D cos(theta) sigma = 4 f cos^2 of a surface without shadows: sigma follows from D, D from sigma
        seen = np.interp(np.pi / 2 * x**2, theta, f * np.cos(theta))
        sigma = np.cos(np.pi / 2 * np.linspace(0, 1, 64) ** 2)[None].repeat(2, 0)
        for _ in range(ITERATIONS):
            d = seen * np.interp(x, np.linspace(0, 1, 64), sigma[0])
            d = np.maximum(d, 1e-6 * d.max())
            self.ndf = np.repeat(d[None] / _cosine_integral(d, x), 2, 0)
            sigma = projected_area(self.ndf, 64, 2)
        self.sigma = sigma
        self.values = np.zeros((0, 1))
        y, x = np.meshgrid(np.linspace(0, 1, ROWS), x, indexing="ij")
        m = from_angles(np.pi / 2 * x.ravel() ** 2, np.pi * (2 * y.ravel() - 1))
        area = x.ravel() * np.sin(np.pi / 2 * x.ravel() ** 2)
        d = np.tile(self.ndf[0], ROWS) * area
        vndf = np.array([d * np.maximum(m @ w, 0) for w in from_angles(THETA_I, 0 * THETA_I)])
        self.vndf = (vndf / vndf.mean(1, keepdims=True)).reshape(len(THETA_I), ROWS, COLUMNS)

    def slices(self, k: int) -> tuple[Array, Array]:
        """wi, wo (8 k k, 3)."""
        v, u = (q.ravel() for q in np.meshgrid(*2 * [np.linspace(0, 1, k)], indexing="ij"))
        which = np.repeat(np.arange(len(THETA_I)), k * k)
        at = [(which, np.ones(len(which)))]
        x, y, _ = Warp(self.vndf).sample(np.tile(u, len(THETA_I)), np.tile(v, len(THETA_I)), at)
        wi = from_angles(THETA_I, 0 * THETA_I)[which]
        return wi, reflect(wi, from_angles(np.pi / 2 * x**2, np.pi * (2 * y - 1)))

    def table(self) -> Brdf:
        """Their table: what was not measured has the nearest node's value, an incidence without any its neighbour's."""
        k = round((len(self.values) / len(THETA_I)) ** 0.5)
        wi, wo = self.slices(k)
        h = unit(wi + wo)
        x = np.sqrt(2 / np.pi * np.arctan2(np.hypot(h[:, 0], h[:, 1]), h[:, 2]))
        d = np.interp(x, np.linspace(0, 1, COLUMNS), self.ndf[0])
        sigma = np.interp(np.sqrt(2 / np.pi * THETA_I), np.linspace(0, 1, 64), self.sigma[0])
        scale = wo[:, 2] * 4 * np.repeat(sigma, k * k) / d
        stored = _filled((self.values * scale[:, None]).reshape(len(THETA_I), k, k, -1))
        fields = {
            "theta_i": THETA_I,
            "phi_i": np.zeros(1),
            "sigma": self.sigma,
            "ndf": self.ndf,
            "vndf": self.vndf[None],
            "luminance": np.ones((1, len(THETA_I), 2, 2)),
            "spectra": np.moveaxis(stored, -1, 1)[None],
            "wavelengths": 1.0 + np.arange(stored.shape[-1]),
            "jacobian": np.ones(1, np.uint8),
        }
        return RglBrdf(fields)


def _cosine_integral(d: Array, x: Array) -> float:
    """2 pi integral of D cos sin dtheta, theta = pi/2 x^2."""
    theta = np.pi / 2 * x**2
    return float(2 * np.pi * np.trapezoid(d * np.cos(theta) * np.sin(theta), theta))


def _filled(values: Array) -> Array:
    """(S, k, k, C) without NaN."""
    from scipy.ndimage import distance_transform_edt

    hole = np.isnan(values[..., 0])
    out = values.copy()
    for s in range(len(values)):
        if not hole[s].all():
            nearest = distance_transform_edt(hole[s], return_distances=False, return_indices=True)
            out[s] = values[s][tuple(nearest)]
    known = np.flatnonzero(~hole.all((1, 2)))
    return out[known[np.argmin(np.abs(np.arange(len(out))[:, None] - known), axis=1)]]
