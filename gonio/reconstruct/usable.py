"""Which measurements a fit may use."""

import numpy as np

from gonio.geometry import above_horizon
from gonio.reconstruct import ReconstructionError
from gonio.reconstruct.samples import Samples

LEAST = 30


def usable(samples: Samples) -> Samples:
    """The finite, unsaturated measurements above the horizon, values below 0 (dark subtraction) set to 0.

    Raises ReconstructionError where fewer than 30 are left, or all of them are 0.
    """
    finite = np.isfinite(samples.f).all(1) & np.isfinite(samples.wi).all(1) & np.isfinite(samples.wo).all(1)
    s = samples[finite & ~samples.saturated & above_horizon(samples.wi, samples.wo)]
    if len(s) < LEAST:
        raise ReconstructionError(f"{len(s)} usable samples of {len(samples)}; {LEAST} are needed, measure more")
    f = np.maximum(s.f, 0)
    if not f.any():
        raise ReconstructionError(f"all {len(s)} samples are 0; is the light on?")
    return Samples(s.wi, s.wo, f, s.sigma, s.saturated)
