"""The residual network of one coupling, in NumPy."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gonio.geometry import Array


@dataclass
class Coupling:
    """It moves coordinate `moved` given those in `given`. `constant` is its (warp, shift) where nothing is given."""

    moved: int
    given: list[int]
    periodic: tuple[bool, ...]
    first: Array
    bias: Array
    layers: list[tuple[Array, Array]]
    last: Array
    last_bias: Array
    constant: tuple[Any, Any] | None = None

    def network(self, x: Array) -> Array:
        """Numbers for the warp, (…, outputs), of features (…, inputs), both float32."""
        h = x @ self.first
        h += self.bias
        for (w1, b1), (w2, b2) in zip(self.layers[::2], self.layers[1::2]):
            r = np.maximum(h, 0) @ w1
            r += b1
            np.maximum(r, 0, r)
            r = r @ w2
            r += b2
            h += r
        out = np.maximum(h, 0) @ self.last
        out += self.last_bias
        return out
