"""A BRDF as a table of log ratios to a robust base: quick to look up, small to store.

Isotropic: over (theta_h, theta_d, |phi_d|); anisotropic: over (theta_h, phi_h, theta_d, azimuth of wi - wo).
"""

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.prior.blend import Base, base_from
from gonio.reconstruct.splines.frame import Frame
from gonio.reconstruct.splines.grain import Grain
from gonio.reconstruct.splines.isotropic import Isotropic
from gonio.reconstruct.splines.residual import LogRatio
from gonio.reconstruct.tables.lookup import Lookup
from gonio.reconstruct.tables.sampled import Sampled


class TabulatedBrdf(Sampled):
    """f = g / cos(theta_o), g = `ratio`.inverse(table, base)."""

    kind = "tabulated"

    def __init__(self, frame: Frame, base: Base, ratio: LogRatio, t0: float, values: Array):
        self.frame, self.base, self.ratio, self.t0 = frame, base, ratio, t0
        self.chart = frame.chart(t0)
        self.table = Lookup(values, self.chart.periodic, self.chart.refine)
        self.channels = base.channels

    @classmethod
    def of(cls, frame: Frame, base: Base, ratio: LogRatio, t0: float, log_ratio) -> "TabulatedBrdf":
        """log_ratio(angles) -> (N, C). Asked only where some cell of the table reaches above the horizon."""
        chart = frame.chart(t0)
        a, above = chart.nodes(chart.coarse)
        need = above > -0.15
        values = np.zeros((len(above), base.channels))
        values[need] = log_ratio(a.at(need))
        return cls(frame, base, ratio, t0, values.reshape(*chart.coarse, -1))

    def _above(self, wi: Array, wo: Array) -> Array:
        a = self.frame.angles(wi, wo)
        return self.ratio.inverse(self.table(self.chart(a)), self.base(a)) / a.cos_o[:, None]

    def to_arrays(self) -> dict[str, Array]:
        own = {"floor": self.ratio.floor, "t0": np.array(self.t0)}
        return own | self.base.to_arrays() | {"values": self.table.values} | self.frame.to_arrays()

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "TabulatedBrdf":
        frame: Frame = Grain(*(float(v) for v in d["grain"])) if "grain" in d else Isotropic()
        return cls(frame, base_from(d), LogRatio(d["floor"]), float(d["t0"]), d["values"])
