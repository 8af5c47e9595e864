"""Three channels as red, green and blue, which is what most files mean by three: ordered by their names, or said."""

import re
import warnings
from typing import Any

import numpy as np

from gonio.brdf import Brdf
from gonio.export import ExportWarning
from gonio.geometry import Array

RGB = ("r", "g", "b")


def as_rgb(brdf: Brdf, names: tuple[str, ...]) -> Brdf:
    """`brdf` with its channels in the order red, green, blue; itself where they are, or where there are not three."""
    order = rgb_order(names)
    return brdf if order == list(range(brdf.channels)) or brdf.channels != len(order) else Ordered(brdf, order)


def rgb_order(names: tuple[str, ...]) -> list[int]:
    """Which channel is red, green, blue; as they are where there are not three. Wavelengths: the longest is red.

    Warns (ExportWarning) where names do not say it.
    """
    if len(names) != 3:
        return list(range(len(names)))
    low = [n.strip().lower() for n in names]
    if sorted(n[:1] for n in low) == sorted(RGB) and all(n in (*RGB, "red", "green", "blue") for n in low):
        return [[n[:1] for n in low].index(c) for c in RGB]
    found = [re.fullmatch(r"(\d{3,4}(?:\.\d+)?)\s*(?:nm)?", n) for n in low]
    if all(found):
        return [int(k) for k in np.argsort([-float(m[1]) for m in found if m])]
    said = ", ".join(names)
    warnings.warn(f"channels {said} are written as red, green, blue, in this order", ExportWarning, stacklevel=2)
    return [0, 1, 2]


class Ordered:
    """A BRDF whose channels are those of another in another order."""

    def __init__(self, brdf: Brdf, order: list[int]):
        self.brdf, self.order, self.channels = brdf, order, brdf.channels
        self.sample, self.pdf = brdf.sample, brdf.pdf

    def eval(self, wi: Array, wo: Array) -> Array:
        return self.brdf.eval(wi, wo)[:, self.order]

    def std(self, wi: Array, wo: Array) -> Array:
        whole: Any = self.brdf
        return whole.std(wi, wo)[:, self.order]

    def interval(self, wi: Array, wo: Array, level: float) -> tuple[Array, Array]:
        whole: Any = self.brdf
        low, high = whole.interval(wi, wo, level)
        return low[:, self.order], high[:, self.order]
