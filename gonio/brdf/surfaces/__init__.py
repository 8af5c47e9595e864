"""Surfaces with a shape: what their facets reflect together is a BRDF that no lobe in the house was made for."""

from gonio.brdf.surfaces.micro import MicroSurface
from gonio.brdf.surfaces.read import read_surface

__all__ = ["MicroSurface", "read_surface"]
