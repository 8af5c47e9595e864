"""A prior over isotropic materials: a Gaussian one over the logarithm of f cos(theta_i) cos(theta_o).

    ln(f cos_i cos_o / s + EPS) = (1 + m) mean + sum_k z_k component_k
    ln s ~ N(0, 10^2),  m ~ N(0, 0.3^2),  z_k ~ N(0, 1)

mean and components are those of many materials (principal components, each as long as its standard deviation), as
tables over half and difference angles; `gonio bench prior` makes them of networks of measured materials and of random
lobes. What samples say of z is a linear regression (Rasmussen & Williams 2006, 2.1), a channel at a time. Below the
horizon a table holds ln EPS, which is where cos -> 0 leads.
"""

import os
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from pathlib import Path

import numpy as np

from gonio.brdf.saved import read_arrays
from gonio.geometry import Array
from gonio.reconstruct.splines.isotropic import elevation, radius, theta_d_of, theta_h_of
from gonio.reconstruct.splines.robust_base import Angles
from gonio.reconstruct.tables.lookup import Lookup

EPS = 1e-3
T0 = 0.004  # radians: the narrowest peak that the table resolves
NODES = (64, 32, 10)  # theta_h, theta_d, |phi_d| folded at 90 degrees (reciprocity)
SCALE_SD, MEAN_SD = 10.0, 0.3
UNLIKE = 0.15  # sd of the logarithm of a material about what mean and components can say
LIMIT = 2.0  # sds beyond which a sample has less say (Huber 1964)


class PriorError(Exception):
    """A file that is not a prior over materials: which, why, what to do. One line; exit code 2."""

    exit_code = 2


@dataclass(frozen=True)
class Materials:
    """mean (n,) and components (K, n) at the n nodes of the chart."""

    mean: Array
    components: Array

    @classmethod
    def of(cls, logs: Array, count: int) -> "Materials":
        """Of logs (J, n), a row a material and channel: the `count` largest principal components."""
        mean = logs.mean(0)
        _, length, rows = np.linalg.svd(logs - mean, full_matrices=False)
        return cls(mean, (length[:, None] * rows / np.sqrt(len(logs)))[:count])

    def table_of(self, a: Angles, g: Array, sigma: Array) -> tuple[Array, Array]:
        """The most probable table (n, C) of ln(f cos cos + EPS s), and s (C,), of g = f cos_o, sigma (N, C) at `a`."""
        at = Lookup(self._columns.T.reshape(*NODES, -1), (False,) * 3, (1, 1, 1))(chart(a))
        columns = np.concatenate([np.ones((len(at), 1)), at], 1)
        sds = np.concatenate([[SCALE_SD, MEAN_SD], np.ones(len(self.components))])
        found = [
            _regressed(columns * sds, columns[:, 1], g[:, c] * a.cos_i, sigma[:, c] * a.cos_i)
            for c in range(g.shape[1])
        ]
        z = np.stack([z for z, _ in found], 1) * sds[:, None]
        return z[0] + self.mean[:, None] + self._columns.T @ z[1:], np.array([s for _, s in found])

    @property
    def _columns(self) -> Array:
        return np.concatenate([self.mean[None], self.components])

    def to_arrays(self) -> dict[str, Array]:
        return {"mean": self.mean.astype(np.float16), "components": self.components.astype(np.float16)}


def _regressed(columns: Array, mean: Array, y: Array, sigma: Array) -> tuple[Array, float]:
    """z (K + 2,) in standard deviations, and s, of one channel: y = f cos cos (N,), its noise sigma (N,)."""
    y = np.maximum(y, 0)
    s = float(np.exp(np.mean(np.log(y + EPS * max(y.mean(), 1e-300)) - mean)))
    held = np.ones(len(y))
    z = np.zeros(columns.shape[1])
    for _ in range(4):
        log = np.log(y + EPS * s)
        variance = UNLIKE**2 + (sigma / (y + EPS * s)) ** 2
        w = held / variance
        normal = (columns * w[:, None]).T @ columns + np.eye(len(z))
        z = np.linalg.solve(normal, columns.T @ (w * (log - mean)))
        off = np.abs(log - mean - columns @ z) / np.sqrt(variance)
        held = LIMIT / np.maximum(off, LIMIT)
        s = float(np.exp(np.clip(SCALE_SD * z[0], -600, 600)))
    return z, s


def chart(a: Angles) -> Array:
    """(N, 3) in [0, 1]."""
    folded = 1 - np.abs(2 * a.phi_d / np.pi - 1)
    return np.stack([radius(a.theta_h, T0), elevation(a.theta_d), folded], 1)


def nodes() -> tuple[Array, Array, Array]:
    """theta_h, theta_d, phi_d (n,) of the chart's nodes, row by row."""
    u, v, w = (q.ravel() for q in np.meshgrid(*(np.linspace(0, 1, k) for k in NODES), indexing="ij"))
    return theta_h_of(u, T0), theta_d_of(v), np.pi / 2 * w


@lru_cache(maxsize=2)
def load(path: str | os.PathLike) -> Materials:
    """Raises PriorError, one line."""
    try:
        d = read_arrays(path)
        found = Materials(d["mean"].astype(float), d["components"].astype(float))
    except (OSError, ValueError, KeyError) as e:
        raise PriorError(f"{path}: not a prior over materials ({e}); make one with `gonio bench prior`") from None
    n = int(np.prod(NODES))
    if found.mean.shape != (n,) or found.components.shape[1:] != (n,) or not np.isfinite(found.components).all():
        raise PriorError(f"{path}: a prior over other tables than {NODES}; make it with `gonio bench prior`")
    return found


def shipped() -> Materials:
    """The prior that ships, or that of the file GONIO_PRIOR. Raises PriorError."""
    return load(os.environ.get("GONIO_PRIOR") or Path(str(files("gonio"))) / "reconstruct" / "prior" / "materials.npz")
