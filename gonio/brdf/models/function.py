"""A BRDF that is somebody's own function, for simulated rigs to show and reconstructions to be compared with."""

from collections.abc import Callable

import numpy as np

from gonio.brdf.models.lambert import cosine_hemisphere, cosine_pdf
from gonio.geometry import Array

Function = Callable[[Array, Array], Array]
SLANTED = np.array([[0.6, 0.0, 0.8]])  # a pair that any BRDF has a value for


class FunctionBrdf:
    """f(wi, wo) of a function that takes (N, 3), (N, 3) unit vectors and gives (N, C) or (N,) in 1/sr, no cosine.

    It is asked above the horizon only. The number of channels is what it gives for one pair. Raises ValueError where
    it gives another shape, NaN, infinities or negative values; what the function itself raises is passed on.
    """

    kind = "function"

    def __init__(self, f: Function):
        self.f = f
        self.name = getattr(f, "__name__", type(f).__name__)
        self.channels = self._values(SLANTED, SLANTED * [-1, 1, 1]).shape[1]

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = np.asarray(wi, float), np.asarray(wo, float)
        above = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        out = np.zeros((len(wi), self.channels))
        if above.any():
            values = self._values(wi[above], wo[above])
            if values.shape[1] != self.channels:
                raise ValueError(f"{self.name}: gave {values.shape[1]} channels, and {self.channels} before")
            out[above] = values
        return out

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        """By the cosine: nothing is known of the function."""
        wo = cosine_hemisphere(u)
        return wo, self.pdf(wi, wo)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return np.where(wi[:, 2] > 0, cosine_pdf(wo), 0)

    def _values(self, wi: Array, wo: Array) -> Array:
        try:
            values = np.asarray(self.f(wi, wo), float)
        except (TypeError, ValueError) as e:
            raise ValueError(f"{self.name}: f(wi, wo) of arrays (N, 3), (N, 3) is not an array of numbers: {e}") from e
        if values.ndim == 1:
            values = values[:, None]
        if values.ndim != 2 or len(values) != len(wi) or not 1 <= values.shape[1] <= 512:
            raise ValueError(f"{self.name}: gave an array {values.shape} for {len(wi)} pairs; wanted ({len(wi)}, C)")
        if not (np.isfinite(values).all() and (values >= 0).all()):
            raise ValueError(f"{self.name}: gave a value below 0 or not finite; a BRDF has none")
        return values
