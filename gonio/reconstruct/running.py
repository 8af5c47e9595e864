"""The reconstruction that runs beside an acquisition: quick, refitted from all samples whenever it is asked for."""

import numpy as np

from gonio.reconstruct.auto import AutoBrdf
from gonio.reconstruct.auto import fit as fit_auto
from gonio.reconstruct.samples import Samples


def fit(samples: Samples, *, anisotropic: bool = False) -> AutoBrdf:
    """A surrogate and its `energy_error_estimate`. Raises ReconstructionError."""
    return fit_auto(samples, anisotropic=anisotropic, rng=np.random.default_rng(0))
