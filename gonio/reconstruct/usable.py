"""Which measurements the simple fits use."""

import numpy as np

from gonio.reconstruct.clean import clean
from gonio.reconstruct.samples import Samples


def usable(samples: Samples) -> Samples:
    """The cleaned, unsaturated measurements, values below 0 (dark subtraction) set to 0. Raises ReconstructionError."""
    s = clean(samples)
    s = s[~s.saturated]
    return Samples(s.wi, s.wo, np.maximum(s.f, 0), s.sigma, s.saturated)
