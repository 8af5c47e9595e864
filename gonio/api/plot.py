"""BRDFs that a notebook has in hand can be plotted: `brdf.plot()`."""

from typing import TYPE_CHECKING, Protocol

from gonio.brdf import Brdf

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class PlottedBrdf(Brdf, Protocol):
    """A BRDF with `plot`; one that knows its uncertainty has `std` and `interval` too."""

    def plot(self, theta_i_deg: tuple[float, ...] = (15.0, 45.0, 75.0), *, truth: Brdf | None = None) -> "Figure": ...


def plotted(brdf: Brdf) -> PlottedBrdf:
    """The same object; its class has `plot` from now on, `gonio.render.plane.plot_brdf`."""
    if not hasattr(type(brdf), "plot"):
        type(brdf).plot = _plot  # type: ignore[attr-defined]  # the rooms below know no plots, so it is put here
    return brdf  # type: ignore[return-value]  # it has `plot` now, which no checker can see


def _plot(self, theta_i_deg: tuple[float, ...] = (15.0, 45.0, 75.0), *, truth=None) -> "Figure":
    """f cos θo in the plane of incidence at each of `theta_i_deg`, with the interval of 95 % where it knows one."""
    from gonio.api.rig import as_brdf
    from gonio.render.plane import plot_brdf

    return plot_brdf(self, theta_i_deg, None if truth is None else as_brdf(truth))
