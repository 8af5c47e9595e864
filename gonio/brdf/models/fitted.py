"""Small fits of isotropic materials that ship with gonio as YAML: Lambert + GGX lobes whose colours shift with theta_d.

f = diffuse(theta_d) / pi + sum over lobes of colour(theta_d) D(h) G2(wi, wo) / (4 cos(theta_i) cos(theta_o)),

each colour a quadratic B-spline in theta_d with `SPLINES` coefficients >= 0 per channel: smooth, never negative,
reciprocal and bilateral.
"""

import os
from typing import Any

import numpy as np

from gonio.brdf.base import BrdfFileError
from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.geometry import Array, directions, to_half_diff

SPLINES = 6
MOST_BYTES = 100_000  # a hundred times what ships


class FittedBrdf:
    """alpha (L,) roughnesses > 0; colour (1 + L, SPLINES, C) >= 0, the diffuse part first."""

    kind = "fitted"

    def __init__(self, alpha: Array, colour: Array):
        self.alpha, self.colour = np.atleast_1d(np.asarray(alpha, float)), np.asarray(colour, float)
        if self.colour.shape[:2] != (1 + len(self.alpha), SPLINES) or self.colour.ndim != 3:
            raise ValueError(f"{len(self.alpha)} lobes need colours (1 + lobes, {SPLINES}, C), not {self.colour.shape}")
        if not (np.isfinite(self.colour).all() and (self.colour >= 0).all() and (self.alpha > 0).all()):
            raise ValueError("alpha must be above 0, colours 0 or above")
        self._lobes = [Ggx(a) for a in self.alpha]
        weight = self.colour.mean((1, 2)) + 1e-3 * self.colour.mean()
        self._sampler = Mixture([Lambert(1.0), *self._lobes], weight if weight.sum() > 0 else None)

    @classmethod
    def from_file(cls, path: str | os.PathLike) -> "FittedBrdf":
        """Read a YAML with `alpha` and `colour`. Raises BrdfFileError."""
        return cls.read(path, read_yaml(path))

    @classmethod
    def read(cls, path: str | os.PathLike, d: dict[str, Any]) -> "FittedBrdf":
        """Of the keys of a file. Raises BrdfFileError."""
        try:
            return cls(d["alpha"], d["colour"])
        except (KeyError, TypeError, ValueError) as e:
            raise BrdfFileError(f"{path}: not a fit of a material ({' '.join(str(e).split())})") from None

    @property
    def channels(self) -> int:
        return self.colour.shape[-1]

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = directions(wi), directions(wo)
        out = np.zeros((len(wi), self.channels))
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        a, b = wi[above], wo[above]
        spline = basis(to_half_diff(a, b)[2])
        out[above] = spline @ self.colour[0] / np.pi
        for lobe, colour in zip(self._lobes, self.colour[1:]):
            out[above] += spline @ colour * lobe.eval(a, b)
        return out

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        return self._sampler.sample(wi, u)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self._sampler.pdf(wi, wo)

    def to_arrays(self) -> dict[str, Array]:
        return {"alpha": self.alpha, "colour": self.colour}

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "FittedBrdf":
        return cls(d["alpha"], d["colour"])


def basis(theta_d: Array) -> Array:
    """(N, SPLINES): quadratic B-splines on even, clamped knots over theta_d in [0, pi/2]; each row adds to 1."""
    knots = np.concatenate([[0, 0], np.linspace(0, 1, SPLINES - 1), [1, 1]])
    t = np.clip(np.asarray(theta_d) * 2 / np.pi, 0, 1 - 1e-12)[:, None]
    b = ((knots[:-1] <= t) & (t < knots[1:])).astype(float)
    for degree in (1, 2):
        left, right = knots[degree:-1] - knots[: -degree - 1], knots[degree + 1 :] - knots[1:-degree]
        up = np.divide(t - knots[: -degree - 1], left, out=np.zeros((len(t), len(left))), where=left > 0)
        down = np.divide(knots[degree + 1 :] - t, right, out=np.zeros((len(t), len(right))), where=right > 0)
        b = up * b[:, :-1] + down * b[:, 1:]
    return b


def read_yaml(path: str | os.PathLike) -> dict[str, Any]:
    """What a material's YAML file says. Raises BrdfFileError."""
    import yaml

    try:
        if (size := os.path.getsize(path)) > MOST_BYTES:
            raise ValueError(f"{size} bytes, {MOST_BYTES} is the most that one has")
        with open(path, encoding="utf-8") as stream:
            text = stream.read()
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text)):
            raise ValueError("aliases (*name) are not used here; write it out")
        d = yaml.safe_load(text)
        if not isinstance(d, dict):
            raise ValueError("no keys in it")
        return d
    except (OSError, UnicodeDecodeError, yaml.YAMLError, ValueError, RecursionError) as e:
        raise BrdfFileError(f"{path}: not a fit of a material ({' '.join(str(e).split())})") from None
