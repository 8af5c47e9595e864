"""Microfacet reflection (Cook and Torrance 1982; Walter 2007) with Smith's height-correlated masking (Heitz 2014).

f = weight F(theta_d) D(h) G2(wi, wo) / (4 cos(theta_i) cos(theta_o)),  G2 = 1 / (1 + Lambda(wi) + Lambda(wo)).
"""

from collections.abc import Callable

import numpy as np

from gonio.brdf.models.fresnel import conductor, schlick
from gonio.brdf.models.ndf import BeckmannNdf, GgxNdf, Normals
from gonio.geometry import Array, cos_theta_d, directions, half_vector, reflect


class Microfacet:
    """One lobe. alpha_x, alpha_y are roughnesses (alpha_y = alpha_x unless given), weight scales it, number or (C,).

    Fresnel: Schlick's from `f0` (number or (C,); 1 unless given), or a conductor's from `eta` and `k`, (C,) each.
    """

    kind: str
    ndf_class: Callable[[float, float], Normals]

    def __init__(self, alpha_x: float, alpha_y: float | None = None, f0=1.0, *, eta=None, k=None, weight=1.0):
        if (eta is None) != (k is None):
            raise ValueError("a conductor needs both eta and k")
        self.ndf = self.ndf_class(float(alpha_x), float(alpha_x if alpha_y is None else alpha_y))
        if not (self.ndf.alpha_x > 0 and self.ndf.alpha_y > 0):
            raise ValueError(f"alpha must be above 0, not {self.ndf.alpha_x} and {self.ndf.alpha_y}")
        conducting = eta is not None
        arrays = [np.atleast_1d(np.asarray(a, float)) for a in ((eta, k, weight) if conducting else (f0, weight))]
        arrays = [np.array(a) for a in np.broadcast_arrays(*arrays)]
        self.weight = arrays[-1]
        self.f0: Array | None = None if conducting else arrays[0]
        self.eta: Array | None = arrays[0] if conducting else None
        self.k: Array | None = arrays[1] if conducting else None

    @property
    def channels(self) -> int:
        return len(self.weight)

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = directions(wi), directions(wo)
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        if above.all():
            return self._eval(wi, wo)
        out = np.zeros((len(wi), self.channels))
        out[above] = self._eval(wi[above], wo[above])
        return out

    def _eval(self, a: Array, b: Array) -> Array:
        h = half_vector(a, b)
        c = cos_theta_d(a, b)
        fresnel = schlick(c, self.f0) if self.f0 is not None else conductor(c, self.eta, self.k)
        shape = self.ndf.d(h) / ((1 + self.ndf.smith_lambda(a) + self.ndf.smith_lambda(b)) * 4 * a[:, 2] * b[:, 2])
        return self.weight * fresnel * shape[:, None]

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        h = self.ndf.sample(wi, u)
        wo = reflect(wi, h)
        return wo, self.pdf(wi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        """The normals' density over |dwo/dh| = 4 (wi.h); draws that fell below the horizon are lost."""
        wi, wo = directions(wi), directions(wo)
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        out = np.zeros(len(wi))
        a, b = wi[above], wo[above]
        h = half_vector(a, b)
        out[above] = self.ndf.pdf(a, h) / (4 * np.einsum("ni,ni->n", a, h))  # the very factor that some normals have
        return out

    def to_arrays(self) -> dict[str, Array]:
        d = {"alpha": np.array([self.ndf.alpha_x, self.ndf.alpha_y]), "weight": self.weight}
        fresnel = {"f0": self.f0, "eta": self.eta, "k": self.k}
        return d | {key: v for key, v in fresnel.items() if v is not None}

    @classmethod
    def from_arrays(cls, d: dict[str, Array]):
        alpha_x, alpha_y = (float(a) for a in d["alpha"])
        if "eta" in d:
            return cls(alpha_x, alpha_y, eta=d["eta"], k=d["k"], weight=d["weight"])
        return cls(alpha_x, alpha_y, d["f0"], weight=d["weight"])


class Ggx(Microfacet):
    """`Microfacet` with GGX normals, sampled by the visible ones."""

    kind = "ggx"
    ndf_class = GgxNdf


class Beckmann(Microfacet):
    """`Microfacet` with Beckmann normals, sampled by D cos(theta_h)."""

    kind = "beckmann"
    ndf_class = BeckmannNdf
