"""Moves in a unit cube: a Gaussian step, or with a given share a fresh uniform point (METHOD 2)."""

import numpy as np

from gonio.geometry import Array
from gonio.mcmc.chain.boundary import reflect, wrap
from gonio.mcmc.proposals import GLOBAL


class CubeStep:
    """u -> u + sigma N(0, 1) per coordinate, or uniform with probability `global_share`.

    boundary `reflect` mirrors at the faces (coordinates in `periodic` wrap); `wrap` wraps all, as the thesis does.
    """

    def __init__(self, dimensions: int, sigma: float, global_share: float, boundary: str, periodic: tuple[int, ...]):
        self.dimensions, self.sigma, self.global_share = dimensions, sigma, global_share
        self.uniforms, self.normals = dimensions + 1, dimensions
        self.boundary, self.periodic = boundary, periodic

    def __call__(self, u: Array | None, uniform: Array, normal: Array) -> tuple[Array, Array]:
        """New u (n, N) and kind (N,) from uniform (n + 1, N) and normal (n, N)."""
        fresh = uniform[1:]
        if u is None:
            return fresh, np.full(fresh.shape[1], GLOBAL, np.int8)
        moved = u + self.sigma * normal
        if self.boundary == "wrap":
            moved = wrap(moved)
        else:
            for k in self.periodic:
                moved[k] = wrap(moved[k])
            moved = reflect(moved)
        jump = uniform[0] < self.global_share
        return np.where(jump, fresh, moved), jump.view(np.int8)  # LOCAL = 0, GLOBAL = 1
