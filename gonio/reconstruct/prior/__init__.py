"""What materials look like, before any of a sample is measured: for the base under few samples."""

from gonio.reconstruct.prior.blend import Blend
from gonio.reconstruct.prior.materials import Materials, PriorError, shipped

__all__ = ["Blend", "Materials", "PriorError", "shipped"]
