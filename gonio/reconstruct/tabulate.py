"""A BRDF as a table of log ratios to a robust base: quick to look up, small to store.

Isotropic: over (theta_h, theta_d, |phi_d|); anisotropic: over (theta_h, phi_h, theta_d, azimuth of wi - wo).
"""

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.frame import Frame
from gonio.reconstruct.grain import Grain
from gonio.reconstruct.half_grid import HalfGrid
from gonio.reconstruct.isotropic import Isotropic
from gonio.reconstruct.lookup import Lookup
from gonio.reconstruct.residual import LogRatio
from gonio.reconstruct.robust_base import RobustBase

CHUNK = 1 << 15  # what the processor's cache holds


class TabulatedBrdf:
    """f = g / cos(theta_o), g = `ratio`.inverse(table, base)."""

    kind = "tabulated"

    def __init__(self, frame: Frame, base: RobustBase, ratio: LogRatio, t0: float, values: Array):
        self.frame, self.base, self.ratio, self.t0 = frame, base, ratio, t0
        self.chart = frame.chart(t0)
        self.table = Lookup(values, self.chart.periodic, self.chart.refine)
        self._sampler: HalfGrid | None = None

    @classmethod
    def of(cls, frame: Frame, base: RobustBase, ratio: LogRatio, t0: float, log_ratio) -> "TabulatedBrdf":
        """log_ratio(angles) -> (N, C). Asked only where some cell of the table reaches above the horizon."""
        chart = frame.chart(t0)
        a, above = chart.nodes(chart.coarse)
        need = above > -0.15
        values = np.zeros((len(above), base.weights.shape[1]))
        values[need] = log_ratio(a.at(need))
        return cls(frame, base, ratio, t0, values.reshape(*chart.coarse, -1))

    @property
    def channels(self) -> int:
        return self.base.weights.shape[1]

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = np.atleast_2d(np.asarray(wi, float)), np.atleast_2d(np.asarray(wo, float))
        out = np.zeros((len(wi), self.channels))
        for start in range(0, len(wi), CHUNK):
            part = slice(start, start + CHUNK)
            up = (wi[part, 2] > 0) & (wo[part, 2] > 0)
            if up.all():
                out[part] = self._eval_above(wi[part], wo[part])
            elif up.any():
                out[part][up] = self._eval_above(wi[part][up], wo[part][up])
        return out

    def _eval_above(self, wi: Array, wo: Array) -> Array:
        a = self.frame.angles(wi, wo)
        return self.ratio.inverse(self.table(self.chart(a)), self.base(a)) / a.cos_o[:, None]

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        return self.sampler.sample(wi, u)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self.sampler.pdf(wi, wo)

    @property
    def sampler(self) -> HalfGrid:
        """Made when first asked for: a reconstruction that is only looked at does not pay for it."""
        if self._sampler is None:
            self._sampler = HalfGrid.of(self.eval, self.t0, azimuths=8 if isinstance(self.frame, Grain) else 1)
        return self._sampler

    def to_arrays(self) -> dict[str, Array]:
        own = {"weights": self.base.weights, "floor": self.ratio.floor, "t0": np.array(self.t0)}
        return own | {"values": self.table.values} | self.frame.to_arrays()

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "TabulatedBrdf":
        frame: Frame = Grain(*(float(v) for v in d["grain"])) if "grain" in d else Isotropic()
        return cls(frame, RobustBase(d["weights"]), LogRatio(d["floor"]), float(d["t0"]), d["values"])
