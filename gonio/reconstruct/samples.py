"""What was measured, as a reconstruction sees it."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array


@dataclass(frozen=True)
class Samples:
    """N measurements, one row per rig visit (rejected proposals included, repeats counted once).

    wi, wo   (N, 3) unit vectors as achieved
    f        (N, C) BRDF values in 1/sr (cosine not included); may be slightly negative after dark subtraction
    sigma    (N, C) standard deviation of f; 0 where the measurement has no noise
    saturated (N,) the reading was above the detector's range: f is a lower bound, not a value
    """

    wi: Array
    wo: Array
    f: Array
    sigma: Array
    saturated: NDArray[np.bool_]

    @classmethod
    def of(cls, wi, wo, f, sigma=None, saturated=None) -> "Samples":
        """Samples from plain arrays; sigma = 0 and nothing saturated unless given."""
        wi, wo, f = (np.array(a, np.float64, ndmin=2) for a in (wi, wo, f))
        sigma = np.zeros_like(f) if sigma is None else np.broadcast_to(np.asarray(sigma, float), f.shape).copy()
        saturated = np.zeros(len(f), bool) if saturated is None else np.asarray(saturated, bool)
        return cls(wi, wo, f, sigma, saturated)

    def __len__(self) -> int:
        return len(self.f)

    def __getitem__(self, index) -> "Samples":
        return replace(self, **{k.name: getattr(self, k.name)[index] for k in fields(self)})
