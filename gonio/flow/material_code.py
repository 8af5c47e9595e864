"""The code of a material: the few numbers at which a conditional flow is most likely to have made its samples.

Maximum a posteriori of n_eff * weighted log-likelihood under a normal fitted to the codes of training, from the best
few of those codes, by L-BFGS with finite differences: no torch, and cheap, since a code only moves the biases.
"""

import numpy as np

from gonio.flow.flow import Flow
from gonio.geometry import Array

STARTS = 2
POINTS = 400  # of largest weight, used for one fit
STEP = 3e-3
FARTHEST = 4.0  # standard deviations of the training's codes, along each of their axes


class Codes:
    """The codes (M, C) of the materials a flow was trained on, and what is typical of them."""

    def __init__(self, table: Array):
        self.table = np.asarray(table, float)
        self.mean = self.table.mean(0)
        spread, axes = np.linalg.eigh(np.cov(self.table.T) + 1e-6 * np.eye(table.shape[1]))
        self._to_unit, self._from_unit = axes / np.sqrt(spread), (axes * np.sqrt(spread)).T

    def unit(self, code: Array) -> Array:
        """The code in coordinates in which the training's are a unit normal."""
        return (code - self.mean) @ self._to_unit

    def code(self, unit: Array) -> Array:
        return self.mean + unit @ self._from_unit

    def inside(self, unit: Array) -> Array:
        return np.clip(unit, -FARTHEST, FARTHEST)

    def fit(self, flow: Flow, x: Array, weight: Array, start: Array | None = None) -> Array:
        """The code (C,) for points x (N, D) of the cube with weights (N,) >= 0; from `start` if there is one."""
        from scipy.optimize import minimize

        top = np.argsort(weight)[-POINTS:]
        x, w = x[top], weight[top] / weight[top].sum()
        effective = 1 / np.sum(w * w)

        def loss(unit: Array) -> float:
            return float(-effective * (w @ flow.at(self.code(unit)).log_prob(x)) + 0.5 * unit @ unit)

        def loss_and_gradient(unit: Array) -> tuple[float, Array]:
            here = loss(unit)
            steps = STEP * np.eye(len(unit))
            return here, np.array([(loss(unit + s) - here) / STEP for s in steps])

        if start is None:
            few = slice(None, None, max(1, len(x) // 150))
            likely = [-(w[few] @ flow.at(c).log_prob(x[few])) for c in self.table]
            starts = self.table[np.argsort(likely)[:STARTS]]
        else:
            starts = np.atleast_2d(start)
        bounds = [(-FARTHEST, FARTHEST)] * len(self.mean)
        best = min(
            (
                minimize(
                    loss_and_gradient,
                    self.inside(self.unit(s)),
                    jac=True,
                    method="L-BFGS-B",
                    bounds=bounds,
                    options={"maxiter": 20 if start is None else 4, "ftol": 1e-5},
                )
                for s in starts
            ),
            key=lambda r: r.fun,
        )
        return self.code(best.x)
