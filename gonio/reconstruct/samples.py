"""What was measured, as a reconstruction sees it."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array


@dataclass(frozen=True)
class OnWay:
    """How N samples were read, some of them while the arms moved.

    move   (N,) the number of the move, in the order they were made; a stop has that of the move which led to it
    flown  (N,) read while the arms moved
    along  (N,) rad: standard deviation of where on its path sqrt(|dwi|^2 + |dwo|^2) a sample lies, its own part
    shared (N,) rad: the part that all samples of one move have in common; both 0 at stops
    """

    move: NDArray[np.int64]
    flown: NDArray[np.bool_]
    along: Array
    shared: Array

    def __getitem__(self, index) -> "OnWay":
        return OnWay(*(getattr(self, k.name)[index] for k in fields(self)))


@dataclass(frozen=True)
class Samples:
    """N measurements, one row per rig visit (rejected proposals included, repeats counted once), and per reading on
    the way where there are any.

    wi, wo   (N, 3) unit vectors as achieved
    f        (N, C) BRDF values in 1/sr (cosine not included); may be slightly negative after dark subtraction
    sigma    (N, C) standard deviation of f; 0 where the measurement has no noise
    saturated (N,) the reading was above the detector's range: f is a lower bound, not a value
    on_way   how they were read; None = all at rest
    """

    wi: Array
    wo: Array
    f: Array
    sigma: Array
    saturated: NDArray[np.bool_]
    on_way: OnWay | None = None

    @classmethod
    def of(cls, wi, wo, f, sigma=None, saturated=None, on_way: OnWay | None = None) -> "Samples":
        """Samples from plain arrays; sigma = 0, nothing saturated, all at rest unless given."""
        wi, wo, f = (np.array(a, np.float64, ndmin=2) for a in (wi, wo, f))
        sigma = np.zeros_like(f) if sigma is None else np.broadcast_to(np.asarray(sigma, float), f.shape).copy()
        saturated = np.zeros(len(f), bool) if saturated is None else np.asarray(saturated, bool)
        return cls(wi, wo, f, sigma, saturated, on_way)

    def __len__(self) -> int:
        return len(self.f)

    def __getitem__(self, index) -> "Samples":
        on_way = None if self.on_way is None else self.on_way[index]
        wi, wo, f, sigma, saturated = (v[index] for v in (self.wi, self.wo, self.f, self.sigma, self.saturated))
        return Samples(wi, wo, f, sigma, saturated, on_way)

    @property
    def stops(self) -> "Samples":
        """Those read at rest, without a word of how."""
        at_rest = self if self.on_way is None else self[~self.on_way.flown]
        return replace(at_rest, on_way=None)
