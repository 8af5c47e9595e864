"""BRDF models and file formats. Every one of them is a `Brdf`."""

from gonio.brdf.abc import Abc
from gonio.brdf.base import Brdf, BrdfFileError
from gonio.brdf.lambert import Lambert
from gonio.brdf.merl import MerlBrdf
from gonio.brdf.microfacet import Beckmann, Ggx
from gonio.brdf.mixture import Mixture
from gonio.brdf.network import NetworkBrdf
from gonio.brdf.rgl import RglBrdf

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
