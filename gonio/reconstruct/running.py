"""The reconstruction that runs beside an acquisition: the same splines, few choices, no table.

For the stop rule (`energy_error_estimate`) and as the surrogate of a delayed acceptance: `eval` never falls below a
floor, since a surrogate that says 0 where the sample does not would close that region to the chain.
"""

import numpy as np

from gonio.geometry import Array
from gonio.reconstruct.clean import clean
from gonio.reconstruct.samples import Samples
from gonio.reconstruct.splines.auto import Problem, peak_width
from gonio.reconstruct.splines.frame import Coordinates, Frame
from gonio.reconstruct.splines.grain import Grain
from gonio.reconstruct.splines.held_out import EnergyError
from gonio.reconstruct.splines.isotropic import Isotropic
from gonio.reconstruct.splines.patches import Patches, left_out
from gonio.reconstruct.tables.sampled import Sampled

TESTED = 300
FLOOR = 0.01


class RunningBrdf(Sampled):
    """Splines asked directly: right for hundreds of pairs at a time, not for rendering. Not saved."""

    def __init__(self, problem: Problem, stretch: Coordinates, energy_error_estimate: float):
        self.problem, self.stretch, self.energy_error_estimate = problem, stretch, energy_error_estimate
        self.frame, self.t0, self.channels = problem.frame, stretch.t0, problem.g.shape[1]
        self._patches = Patches(stretch(problem.angles), problem.y, problem.variance)
        self._floor = FLOOR * problem.ratio.floor

    def _above(self, wi: Array, wo: Array) -> Array:
        p = self.problem
        a = p.frame.angles(wi, wo)
        g = p.ratio.inverse(self._patches(self.stretch(a)), p.base(a))
        return np.maximum(g, self._floor) / a.cos_o[:, None]


def fit(samples: Samples, *, anisotropic: bool = False) -> RunningBrdf:
    """A surrogate of all samples so far. Saturated readings are left out. Raises ReconstructionError."""
    rng = np.random.default_rng(0)
    s = clean(samples)
    s = s[~s.saturated]
    frame: Frame = Grain.of(s.wi, s.wo, np.maximum(s.f, 0)) if anisotropic else Isotropic()
    p = Problem.of(s, frame, rng)
    test = rng.permutation(len(s))[:TESTED]
    width = peak_width(p)
    error = EnergyError(p.angles, p.g, p.sigma, frame.stretch(width), test)
    tried = {}
    for t0 in (width / 2, 2 * width):
        stretch = frame.stretch(t0)
        tried[stretch] = error(p.ratio.inverse(left_out(stretch(p.angles), p.y, p.variance, test), p.b[test]))
    best = min(tried, key=lambda k: tried[k])
    return RunningBrdf(p, best, tried[best])
