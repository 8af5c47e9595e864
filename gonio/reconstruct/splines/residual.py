"""The logarithm that is interpolated: of measured g = f cos(theta_o) over the base's, held finite at both ends.

    y = ln((g + k b + e) / ((1 + k) b + e)),   k = 0.1, e = a floor per channel

so that a measured 0 is y = ln(k / (1 + k)) and not minus infinity, and one outlying zero beside the horizon cannot
drag its neighbours down by decades. Noise: sd(y) = sd(g) / (g + k b + e).
"""

from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array

K = 0.1
LARGEST = 12.0
LEAST = 0.1  # of the floor, where noise leads below it


@dataclass(frozen=True)
class LogRatio:
    """`floor` (C,), in 1/sr."""

    floor: Array

    @classmethod
    def of(cls, g: Array, sigma: Array) -> "LogRatio":
        """The floor lies where neither the noise nor the energy lets a logarithm mean anything."""
        positive = np.maximum(g, 0)
        mean = positive.mean(0)
        floor = 1e-3 * np.minimum(np.median(positive, 0), mean) + 1e-4 * np.quantile(positive, 0.75, axis=0)
        return cls(np.maximum.reduce([3 * np.median(sigma, 0), floor, np.full_like(floor, 1e-6 * mean.max())]))

    def forward(self, g: Array, b: Array) -> Array:
        # g below 0 counts as what it is: noise cut off at 0 would make a dark sample bright
        return np.log(np.maximum(g + K * b + self.floor, LEAST * self.floor) / ((1 + K) * b + self.floor))

    def inverse(self, y: Array, b: Array) -> Array:
        g = ((1 + K) * b + self.floor) * np.exp(np.clip(y, -LARGEST, LARGEST)) - self.floor - K * b
        return np.maximum(g, 0)

    def slope(self, g: Array, b: Array) -> Array:
        """dg / dy, (N, C)."""
        return g + K * b + self.floor

    def variance(self, g: Array, sigma: Array, b: Array) -> Array:
        """Of y, (N,): the mean over the channels, which share one spline matrix; a dark channel has little say."""
        positive = np.maximum(g, 0)
        slope = self.slope(positive, b)
        say = positive / slope + 1e-6
        return (say * (sigma / slope) ** 2).sum(1) / say.sum(1)
