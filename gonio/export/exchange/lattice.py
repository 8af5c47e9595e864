"""A BRDF on a lattice of three or four angles, as readers of text tables interpolate it, and what that loses."""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.brdf import Brdf
from gonio.evaluate import evaluate
from gonio.export import ExportWarning
from gonio.geometry import Array, from_angles

DRAWS = 4096  # of a reflectance
NOTABLE = 0.01  # energy error worth a word
AWAY = np.radians(np.array([5.0, 15.0, 25.0, 35.0, 45.0, 55.0, 65.0, 75.0]))  # incidences between those of a lattice


class Lattice:
    """values (A, B, ..., C) at axes (radians, ascending), linear between; `to_axes` gives the coordinates of wi, wo."""

    def __init__(self, to_axes: Callable[[Array, Array], tuple[Array, ...]], axes: tuple[Array, ...], values: Array):
        from scipy.interpolate import RegularGridInterpolator

        self.channels = values.shape[-1]
        self._to_axes, self._axes = to_axes, axes
        self._table = RegularGridInterpolator(axes, values)

    def eval(self, wi: Array, wo: Array) -> Array:
        at = [np.clip(x, axis[0], axis[-1]) for x, axis in zip(self._to_axes(wi, wo), self._axes)]
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        return np.where(up[:, None], self._table(np.stack(at, 1)), 0.0)


def say_loss(lattice: Lattice, brdf: Brdf, what: str, theta_i: Array = AWAY) -> float:
    """The energy error of the lattice against the BRDF at theta_i (radians); an ExportWarning where it is notable."""
    # a lattice can be asked and not drawn from, and the referee only asks
    error = evaluate(lattice, brdf, n=1500, theta_i=theta_i)["energy_mean"]  # type: ignore[arg-type]
    if error > NOTABLE:
        line = f"{what} puts {error:.1%} of the reflected energy in the wrong place: what is narrower than its angles"
        warnings.warn(line, ExportWarning, stacklevel=3)
    return error


def reflectances(brdf: Any, theta_i: Array) -> Array:
    """(T, C): directional-hemispherical, at incidences in radians; by draws of the BRDF's own density (Sobol)."""
    from scipy.stats import qmc

    u = qmc.Sobol(2, seed=7).random(DRAWS)
    found = []
    for theta in theta_i:
        wi = np.broadcast_to(from_angles(theta, 0.0), (DRAWS, 3))
        wo, pdf = brdf.sample(wi, u)
        ok = (pdf > 0) & (wo[:, 2] > 0)
        found.append((brdf.eval(wi[ok], wo[ok]) * (wo[ok, 2] / pdf[ok])[:, None]).sum(0) / DRAWS)
    return np.array(found)
