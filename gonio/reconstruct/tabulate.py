"""A BRDF as a table of log ratios to a robust base: quick to look up, small to store.

Isotropic: over (theta_h, theta_d, |phi_d|), the first stretched by the peak, the second towards grazing.
"""

from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.half_grid import HalfGrid
from gonio.reconstruct.lookup import Lookup, nodes
from gonio.reconstruct.residual import LogRatio
from gonio.reconstruct.robust_base import Angles, RobustBase

NODES, REFINE = (96, 64, 40), (3, 2, 2)
GRAZING, GRAZING_AT = 0.3, 0.08
_THETA_D = np.linspace(0, np.pi / 2, 4001)
_AXIS = _THETA_D - GRAZING * np.log(np.cos(_THETA_D) + GRAZING_AT)
_AXIS = (_AXIS - _AXIS[0]) / (_AXIS[-1] - _AXIS[0])


@dataclass(frozen=True)
class Chart:
    """Angles <-> [0, 1]^3; t0 in radians."""

    t0: float
    periodic = (False, False, False)

    def __call__(self, a: Angles) -> Array:
        return np.stack(
            [
                np.arcsinh(a.theta_h / self.t0) / np.arcsinh(np.pi / 2 / self.t0),
                np.interp(a.theta_d, _THETA_D, _AXIS),
                a.phi_d / np.pi,
            ],
            1,
        )

    def nodes(self, n: tuple[int, ...]) -> tuple[Angles, Array]:
        """Angles of all nodes, row by row, and how far above the horizon the lower direction lies (its cosine)."""
        u, v, w = (q.ravel() for q in np.meshgrid(*(nodes(k, False) for k in n), indexing="ij"))
        theta_h = self.t0 * np.sinh(u * np.arcsinh(np.pi / 2 / self.t0))
        theta_d, phi_d = np.interp(v, _AXIS, _THETA_D), np.pi * w
        upright = np.cos(theta_h) * np.cos(theta_d)
        across = np.sin(theta_h) * np.sin(theta_d) * np.cos(phi_d)
        cos_i, cos_o = upright - across, upright + across
        a = Angles(theta_h, theta_d, phi_d, np.maximum(cos_i, 1e-6), np.maximum(cos_o, 1e-6))
        return a, np.minimum(cos_i, cos_o)


class TabulatedBrdf:
    """f = g / cos(theta_o), g = `ratio`.inverse(table, base)."""

    kind = "tabulated"

    def __init__(self, base: RobustBase, ratio: LogRatio, chart: Chart, values: Array):
        self.base, self.ratio, self.chart = base, ratio, chart
        self.table = Lookup(values, chart.periodic, REFINE)
        self._sampler: HalfGrid | None = None

    @classmethod
    def of(cls, base: RobustBase, ratio: LogRatio, chart: Chart, log_ratio) -> "TabulatedBrdf":
        """log_ratio(Angles) -> (N, C). Asked only where some cell of the table reaches above the horizon."""
        a, above = chart.nodes(NODES)
        need = above > -0.15
        values = np.zeros((len(above), base.weights.shape[1]))
        values[need] = log_ratio(a.at(need))
        return cls(base, ratio, chart, values.reshape(*NODES, -1))

    @property
    def channels(self) -> int:
        return self.base.weights.shape[1]

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = np.atleast_2d(np.asarray(wi, float)), np.atleast_2d(np.asarray(wo, float))
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        if up.all() and len(up):
            return self._eval_above(wi, wo)
        out = np.zeros((len(wi), self.channels))
        if up.any():
            out[up] = self._eval_above(wi[up], wo[up])
        return out

    def _eval_above(self, wi: Array, wo: Array) -> Array:
        a = self.angles(wi, wo)
        return self.ratio.inverse(self.table(self.chart(a)), self.base(a)) / a.cos_o[:, None]

    def angles(self, wi: Array, wo: Array) -> Angles:
        return Angles.of(wi, wo)

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        return self.sampler.sample(wi, u)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self.sampler.pdf(wi, wo)

    @property
    def sampler(self) -> HalfGrid:
        """Made when first asked for: a reconstruction that is only looked at does not pay for it."""
        if self._sampler is None:
            self._sampler = HalfGrid.of(self.eval, self.chart.t0)
        return self._sampler

    def to_arrays(self) -> dict[str, Array]:
        return {
            "weights": self.base.weights,
            "floor": self.ratio.floor,
            "t0": np.array(self.chart.t0),
            "values": self.table.values,
        }

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "TabulatedBrdf":
        return cls(RobustBase(d["weights"]), LogRatio(d["floor"]), Chart(float(d["t0"])), d["values"])
