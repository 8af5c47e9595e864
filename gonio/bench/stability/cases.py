"""The public functions that the sweep looks at, each beside its exact self.

A case takes columns of numbers, all float64 (or float32) arrays of one length: alpha, theta_i, theta_o, phi, from which
the pair of directions is made, and two more in [0, 1] for whatever else it wants.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from gonio.bench.stability import exact
from gonio.brdf.models.abc import Abc
from gonio.brdf.models.fresnel import conductor, schlick
from gonio.brdf.models.microfacet import Beckmann, Ggx
from gonio.brdf.models.student import StudentNdf
from gonio.geometry import Array, cos_theta_d, from_angles, from_half_diff, half_vector, to_half_diff, unit
from gonio.mcmc.proposals.ggx_density import log_vndf
from gonio.reconstruct.splines.residual import LogRatio

F0, ETA, METAL = 0.04, 1.5, (0.2, 3.5)
GAMMA = 2.5
LOBES = "alpha 1e-4 ... 1, theta to 89.999 deg, alpha cos theta_d > 1e-6"


@dataclass(frozen=True)
class Inputs:
    """alpha, wi, wo, and u, v in [0, 1]; (N,) and (N, 3)."""

    alpha: Array
    wi: Array
    wo: Array
    u: Array
    v: Array

    @classmethod
    def of(cls, columns: Array, dtype: type = np.float64) -> "Inputs":
        """columns (N, 6): alpha, theta_i, theta_o, phi, u, v, rounded to dtype once."""
        alpha, theta_i, theta_o, phi, u, v = columns.T
        wi, wo = from_angles(theta_i, 0 * phi), from_angles(theta_o, phi)
        return cls(*(a.astype(dtype) for a in (alpha, wi, wo, u, v)))

    def __len__(self) -> int:
        return len(self.alpha)

    def __getitem__(self, k) -> "Inputs":
        return Inputs(self.alpha[k], self.wi[k], self.wo[k], self.u[k], self.v[k])


@dataclass(frozen=True)
class Case:
    """ours(inputs) -> (N,); right(m, alpha, wi, wo, u, v) -> one number, or arrays where `extended` numbers know its
    functions. domain: in words, and of inputs (N,) bool."""

    name: str
    ours: Callable[[Inputs], Array]
    right: Callable[..., Any]
    domain: str
    inside: Callable[[Inputs], Array]
    extended: bool = True


def _each(model: Callable[[float], Any], method: str) -> Callable[[Inputs], Array]:
    """A method (wi, wo) of a model that is made anew for each alpha; of those alike together."""

    def ours(x: Inputs) -> Array:
        out = np.empty(len(x))
        order = np.argsort(x.alpha, kind="stable")
        alphas, first = np.unique(x.alpha[order], return_index=True)
        for a, k in zip(alphas, np.split(order, first[1:])):
            value = getattr(model(float(a)), method)(x.wi[k], x.wo[k])
            out[k] = value[:, 0] if value.ndim == 2 else value
        return out

    return ours


def _off_mirror(x: Inputs) -> Array:
    """theta_h cos(theta_d) > 1e-7: nearer to the mirror direction, or with both nearer to opposite ends of the horizon,
    two unit vectors of float64 do not say where h is."""
    h = half_vector(x.wi, x.wo)
    return np.hypot(h[:, 0], h[:, 1]) * cos_theta_d(x.wi, x.wo) > 1e-7


def _resolved(x: Inputs) -> Array:
    """alpha cos(theta_d) > 1e-6: the same, beside the width of the lobe."""
    return x.alpha * cos_theta_d(x.wi, x.wo) > 1e-6


def _everywhere(x: Inputs) -> Array:
    return np.ones(len(x), bool)


def _round_trip(x: Inputs) -> Array:
    """1 + how far wi, wo are from themselves after half and difference angles."""
    wi, wo = unit(x.wi), unit(x.wo)
    a, b = from_half_diff(*to_half_diff(wi, wo))
    return 1 + np.maximum(np.abs(a - wi).max(1), np.abs(b - wo).max(1))


def _log_ratio(x: Inputs) -> Array:
    """g after forward and inverse, over g: of g from 1e-300 to 1e12, the base within a factor e^4 of it."""
    g = _value(x)
    base = g * np.exp(8 * (x.v.astype(float) - 0.5))
    out = np.empty(len(g))
    for k in range(len(g)):
        ratio = LogRatio(np.array([1e-3 * g[k]]))
        pair = g[k : k + 1, None], base[k : k + 1, None]
        out[k] = ratio.inverse(ratio.forward(*pair), pair[1])[0, 0] / g[k]
    return out


def _value(x: Inputs) -> Array:
    return 10.0 ** (-300 + 312 * x.u.astype(float))


def _scaled(x: Inputs) -> Array:
    """The z of a unit vector made of one 1e-300 to 1e12 times as long, over its own."""
    return unit(x.wi.astype(float) * _value(x)[:, None])[:, 2] / unit(x.wi)[:, 2]


CASES = (
    Case("theta_h", lambda x: to_half_diff(x.wi, x.wo)[0], lambda m, a, wi, wo, u, v: exact.theta_h(m, wi, wo),
         "theta_h cos theta_d > 1e-7", _off_mirror),
    Case("theta_d", lambda x: to_half_diff(x.wi, x.wo)[2], lambda m, a, wi, wo, u, v: exact.theta_d(m, wi, wo),
         "theta_d > 1e-7", lambda x: np.linalg.norm(x.wi.astype(float) - x.wo, axis=1) > 2e-7),
    Case("half/diff round trip", _round_trip, lambda m, a, wi, wo, u, v: 1 + 0 * a, "everywhere", _everywhere),
    Case("unit", _scaled, lambda m, a, wi, wo, u, v: 1 + 0 * a, "lengths 1e-300 ... 1e12", _everywhere),
    Case("schlick", lambda x: schlick(x.u.astype(float), np.array([F0]))[:, 0],
         lambda m, a, wi, wo, u, v: exact.schlick(m, u, F0 + 0 * u), "0 <= cos <= 1", _everywhere),
    Case("conductor", lambda x: conductor(x.u.astype(float), *(np.array([q]) for q in METAL))[:, 0],
         lambda m, a, wi, wo, u, v: exact.conductor(m, u, METAL[0] + 0 * u, METAL[1] + 0 * u),
         "0 <= cos <= 1", _everywhere),
    Case("Ggx.eval", _each(lambda a: Ggx(a, None, [F0]), "eval"),
         lambda m, a, wi, wo, u, v: exact.ggx(m, wi, wo, a, F0 + 0 * a),
         LOBES, _resolved),
    Case("Ggx.pdf", _each(lambda a: Ggx(a, None, [F0]), "pdf"),
         lambda m, a, wi, wo, u, v: exact.ggx_pdf(m, wi, wo, a), LOBES, _resolved),
    Case("log_vndf", lambda x: np.exp(_vndf(x)),
         lambda m, a, wi, wo, u, v: exact.ggx_pdf(m, wi, wo, a), LOBES, _resolved),
    Case("Beckmann.eval", _each(lambda a: Beckmann(a, None, [F0]), "eval"),
         lambda m, a, wi, wo, u, v: exact.beckmann(m, wi, wo, a, F0 + 0 * a), LOBES + ", tan theta_h < 20 alpha",
         lambda x: _resolved(x) & (_slope(x) < 20 * x.alpha), extended=False),
    Case("StudentNdf.d", _each(lambda a: _OfPair(StudentNdf(a, a, GAMMA)), "eval"),
         lambda m, a, wi, wo, u, v: exact.student_d(m, exact.half(m, wi, wo), a, GAMMA + 0 * a),
         LOBES, _resolved),
    Case("Abc.eval", _each(lambda a: Abc([0.0], [1.0], 2 / a**2, GAMMA, ETA), "eval"),
         lambda m, a, wi, wo, u, v: exact.abc(m, wi, wo, 2 / (a * a), GAMMA + 0 * a, ETA + 0 * a),
         LOBES + ", b = 2 / alpha^2", _resolved),
    Case("LogRatio", _log_ratio, lambda m, a, wi, wo, u, v: 1 + 0 * a, "f of 1e-300 ... 1e12", _everywhere),
)  # fmt: skip


class _OfPair:
    """D of the half vector of a pair."""

    def __init__(self, ndf):
        self.ndf = ndf

    def eval(self, wi: Array, wo: Array) -> Array:
        return self.ndf.d(half_vector(wi, wo))


def _vndf(x: Inputs) -> Array:
    """Each pair with its own lobe: those on the diagonal."""
    parts = (x[k : k + 64] for k in range(0, len(x), 64))
    return np.concatenate([log_vndf(p.wi, p.wo, p.alpha, p.alpha).diagonal() for p in parts])


def _slope(x: Inputs) -> Array:
    h = half_vector(x.wi, x.wo)
    return np.hypot(h[:, 0], h[:, 1]) / np.maximum(h[:, 2], 1e-300)
