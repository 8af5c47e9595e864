"""What every BRDF is: analytic model, measured table, reconstruction."""

from typing import Protocol, runtime_checkable

from gonio.geometry import Array


class BrdfFileError(ValueError):
    """A BRDF file that cannot be used: says which file, where in it, and what to do. One line."""

    exit_code = 2


@runtime_checkable
class Brdf(Protocol):
    """f(wi, wo) in 1/sr, cosine NOT included, with a density to sample wo by.

    Directions are (N, 3) float64 unit vectors, z = normal, wi to the light, wo to the detector.
    """

    @property
    def channels(self) -> int:
        """C, the number of values `eval` gives per pair."""
        ...

    def eval(self, wi: Array, wo: Array) -> Array:
        """f, (N, C), >= 0 and finite; 0 where either direction is at or below the horizon."""
        ...

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        """Directions wo (N, 3) and their density (N,) for uniform u (N, 2); pdf = 0 marks a draw below the horizon."""
        ...

    def pdf(self, wi: Array, wo: Array) -> Array:
        """Density of `sample` in solid angle of wo given wi, (N,); its integral may be below 1 (draws lost below)."""
        ...
