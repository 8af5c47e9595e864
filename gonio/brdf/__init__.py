"""BRDF models and file formats. Every one of them is a `Brdf`."""

from gonio.brdf.base import Brdf, BrdfFileError
from gonio.brdf.models.abc import Abc
from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Beckmann, Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.brdf.tables.merl import MerlBrdf
from gonio.brdf.tables.network import NetworkBrdf
from gonio.brdf.tables.rgl import RglBrdf

__all__ = [
    "Abc",
    "Beckmann",
    "Brdf",
    "BrdfFileError",
    "Ggx",
    "Lambert",
    "MerlBrdf",
    "Mixture",
    "NetworkBrdf",
    "RglBrdf",
]
