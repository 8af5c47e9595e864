"""The residual network of one coupling, in NumPy."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gonio.geometry import Array


@dataclass
class Coupling:
    """It moves coordinate `moved` given those in `given`. `constant` is its (warp, shift) where nothing is given.

    Each matrix (inputs + 1, outputs) has the biases as its last row, the weights of an input that is always 1.
    """

    moved: int
    given: list[int]
    periodic: tuple[bool, ...]
    first: Array
    layers: list[Array]
    last: Array
    constant: tuple[Any, Any] | None = None

    def network(self, x: Array) -> Array:
        """Numbers for the warp, (outputs, N), of features (N, inputs + 1), both float32; (outputs,) of (inputs + 1,).

        Units lie along the first axis; ReLU is the maximum with an array, four times faster than with a number.
        """
        h = self.first.T @ x.T
        zero, step = np.zeros_like(h), np.empty_like(h)
        shown = np.ones((len(h) + 1, *h.shape[1:]), np.float32)
        units = shown[:-1]
        for w1, w2 in zip(self.layers[::2], self.layers[1::2]):
            np.maximum(h, zero, out=units)
            np.dot(w1.T, shown, out=step)
            np.maximum(step, zero, out=units)
            np.dot(w2.T, shown, out=step)
            h += step
        np.maximum(h, zero, out=units)
        return self.last.T @ shown
