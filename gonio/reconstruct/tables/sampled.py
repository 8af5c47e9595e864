"""What every reconstruction by splines offers a renderer: `eval` for any directions, draws by a `HalfGrid`."""

import numpy as np

from gonio.geometry import Array, directions
from gonio.reconstruct.splines.frame import Frame
from gonio.reconstruct.splines.grain import Grain
from gonio.reconstruct.tables.half_grid import HalfGrid

CHUNK = 1 << 15  # what the processor's cache holds
AZIMUTHS = 8  # of wi, where the surface is anisotropic


class Sampled:
    """`eval`, `sample` and `pdf` of a BRDF that says f above the horizon (`_above`); t0: its peak's width, radians."""

    frame: Frame
    t0: float
    channels: int
    _sampler: HalfGrid | None = None

    def _above(self, wi: Array, wo: Array) -> Array:
        """f (N, C) of pairs above the horizon."""
        raise NotImplementedError

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = directions(wi), directions(wo)
        out = np.zeros((len(wi), self.channels))
        for start in range(0, len(wi), CHUNK):
            part = slice(start, start + CHUNK)
            up = (wi[part, 2] > 0) & (wo[part, 2] > 0)
            if up.all():
                out[part] = self._above(wi[part], wo[part])
            elif up.any():
                out[part][up] = self._above(wi[part][up], wo[part][up])
        return out

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        return self.sampler.sample(wi, u)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self.sampler.pdf(wi, wo)

    @property
    def sampler(self) -> HalfGrid:
        """Made when first asked for: a reconstruction that is only looked at does not pay for it."""
        if self._sampler is None:
            self._sampler = HalfGrid.of(self.eval, self.t0, AZIMUTHS if isinstance(self.frame, Grain) else 1)
        return self._sampler
