"""`flow` in the thesis's own coordinates, half/difference angles, from nothing pretrained."""

import numpy as np

from gonio.reconstruct.flows import flow
from gonio.reconstruct.samples import Samples


def fit(samples: Samples, *, anisotropic: bool, rng: np.random.Generator) -> flow.FlowBrdf:
    """Raises ReconstructionError for samples too few or too poor."""
    return flow.fit(samples, anisotropic=anisotropic, rng=rng, coordinates="raw")
