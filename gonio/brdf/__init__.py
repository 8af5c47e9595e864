"""BRDF models and file formats. Every one of them is a `Brdf`."""

from gonio.brdf.base import Brdf, BrdfFileError

__all__ = ["Brdf", "BrdfFileError"]
