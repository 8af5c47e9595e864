"""The neural BRDFs of Sztrajman et al. 2021: 6-21-21-3 networks on the Cartesian half and difference vectors."""

import os

import numpy as np

from gonio.brdf.base import BrdfFileError
from gonio.brdf.models.half_sampler import HalfSampler
from gonio.brdf.saved import read_arrays
from gonio.geometry import Array, directions, to_half_diff

LAYERS = ((6, 21), (21,), (21, 21), (21,), (21, 3), (3,))


class NetworkBrdf:
    """One network, `weights` (675,), averaged over phi_d, -phi_d, phi_d + pi, pi - phi_d: reciprocal and bilateral.

    Layers relu, relu, exp(x) - 1, clamped at 0; linear RGB, cosine not included.
    """

    channels = 3

    def __init__(self, weights: Array):
        self._layers, at = [], 0
        for shape in LAYERS:
            n = int(np.prod(shape))
            self._layers.append(np.asarray(weights[at : at + n], float).reshape(shape))
            at += n
        edges = np.pi / 2 * np.linspace(0, 1, 129) ** 2
        middle = 0.5 * (edges[1:] + edges[:-1])
        f = sum(self._net(middle, np.full(128, d), np.full(128, p)) for d in (0.2, 0.7) for p in (0.4, 1.6, 2.8))
        self._sampler = HalfSampler(edges, np.asarray(f).mean(1) * np.cos(middle) * np.diff(-np.cos(edges)))

    @classmethod
    def from_file(cls, path: str | os.PathLike, name: str) -> "NetworkBrdf":
        """The network `name` of an .npz with `names` (M,) and `weights` (M, 675). Raises BrdfFileError."""
        try:
            d = read_arrays(path)
            names, weights = [str(n) for n in d["names"]], d["weights"]
        except (OSError, ValueError, KeyError) as e:
            raise BrdfFileError(f"{path}: not a file of networks ({e})") from None
        if name not in names:
            from difflib import get_close_matches

            near = get_close_matches(name, names, 3) or names[:3]
            raise BrdfFileError(f"{path}: no network '{name}' among its {len(names)}; did you mean {', '.join(near)}?")
        w = weights[names.index(name)]
        if w.shape != (675,) or not np.isfinite(w).all():
            raise BrdfFileError(f"{path}: network '{name}' has not 675 finite weights")
        return cls(w)

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = directions(wi), directions(wo)
        out = np.zeros((len(wi), 3))
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        theta_h, _, theta_d, phi_d = to_half_diff(wi[above], wo[above])
        out[above] = 0.25 * sum(self._net(theta_h, theta_d, p) for p in (phi_d, -phi_d, phi_d + np.pi, np.pi - phi_d))
        return out

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        return self._sampler.sample(wi, u)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self._sampler.pdf(wi, wo)

    def _net(self, theta_h: Array, theta_d: Array, phi_d: Array) -> Array:
        w1, b1, w2, b2, w3, b3 = self._layers
        s = np.sin(theta_d)
        x = np.stack(
            [np.sin(theta_h), 0 * theta_h, np.cos(theta_h), s * np.cos(phi_d), s * np.sin(phi_d), np.cos(theta_d)], -1
        )
        y = np.maximum(np.maximum(x @ w1 + b1, 0) @ w2 + b2, 0) @ w3 + b3
        return np.maximum(np.expm1(np.minimum(y, 30)), 0)
