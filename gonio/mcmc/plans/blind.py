"""What takes the place of a running reconstruction while there is none: everything alike, everything unknown."""

import numpy as np

from gonio.geometry import Array, to_half_diff
from gonio.mcmc.proposals.pool import Pool

WIDTH = 0.2  # radians


class Blind:
    """f = 1 and no more known here than there; see `gonio.mcmc.plans.epoch.Running`."""

    t0, dimensions = WIDTH, 4

    def __init__(self, channels: int):
        self.channels = channels

    def eval(self, wi: Array, wo: Array) -> Array:
        return np.ones((len(wi), self.channels))

    def coordinates(self, wi: Array, wo: Array) -> Array:
        """(N, 6): half and difference by asinh(theta_h / t), theta_d and their azimuths on circles."""
        theta_h, phi_h, theta_d, phi_d = to_half_diff(wi, wo)
        h, d = np.sin(theta_h), np.sin(theta_d)
        around = [h * np.cos(phi_h), h * np.sin(phi_h), d * np.cos(phi_d), d * np.sin(phi_d)]
        return np.stack([np.arcsinh(theta_h / WIDTH), theta_d, *around], 1)

    def measure(self, wi: Array, wo: Array) -> Array:
        return np.exp(-Pool(WIDTH).log_prob(wi, wo))

    def roughness(self, wi: Array, wo: Array) -> Array:
        return np.ones(len(wi))
