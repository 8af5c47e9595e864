"""Flow primary sample space (thesis 3.5): the chain walks in the cube that the flow unfolds to directions.

u are the flow's base coordinates, x = flow^-1(u) a point of its cube: |d(wi, wo)/du| = 1/q. Where the flow has the
target's shape every weight is the same and every move accepted; what the flow leaves out is all but out of reach.
"""

from gonio.flow.density import FlowDensity
from gonio.geometry import Array
from gonio.mcmc.proposals.cube import CubeStep


class FlowPss:
    def __init__(self, density: FlowDensity, *, sigma: float, global_share: float, boundary: str):
        self.density = density
        cube = density.cube
        self.step = CubeStep(cube.dimensions, sigma, global_share, boundary, cube.periodic)
        self.uniforms, self.normals = self.step.uniforms, self.step.normals

    def propose(self, u: Array | None, uniform: Array, normal: Array) -> tuple[Array, Array]:
        return self.step(u, uniform, normal)

    def place(self, u: Array) -> tuple[Array, Array, Array]:
        x, log_q = self.density.flow.from_base(u.T)
        wi, wo = self.density.cube.to_directions(x)
        return wi, wo, self.density.cube.log_jacobian(x, wi, wo) - log_q

    def to_directions(self, u: Array) -> tuple[Array, Array]:
        return self.place(u)[:2]

    def from_directions(self, wi: Array, wo: Array) -> Array:
        return self.density.flow.to_base(self.density.cube.from_directions(wi, wo))[0].T

    def log_jacobian(self, u: Array) -> Array:
        """log |d(wi, wo)/du|; isotropic: for one mirror image and azimuth."""
        return self.place(u)[2]
