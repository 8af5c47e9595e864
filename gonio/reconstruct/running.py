"""The reconstruction that runs beside an acquisition: the same patches and posterior, few choices, no table.

For the stop rule (`energy_error_estimate`, of the whole domain) and as the surrogate of a delayed acceptance: `eval`
never falls below a floor, since a surrogate that says 0 where the sample does not would close that region to the chain.
"""

from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from gonio.geometry import Array
from gonio.reconstruct.clean import clean
from gonio.reconstruct.samples import Samples
from gonio.reconstruct.splines.auto import TRUSTED, Problem, peak_width
from gonio.reconstruct.splines.expected_error import MEAN_OVER_68, expected_error
from gonio.reconstruct.splines.few import FEW, said_by_others
from gonio.reconstruct.splines.frame import Coordinates, Frame
from gonio.reconstruct.splines.grain import Grain
from gonio.reconstruct.splines.held_out import EnergyError, solid_angles
from gonio.reconstruct.splines.isotropic import Isotropic
from gonio.reconstruct.splines.patches import Patches, left_out, left_out_with_variance
from gonio.reconstruct.splines.posterior import Posterior
from gonio.reconstruct.tables.sampled import Sampled

TESTED = 300
LOOKED_AT, POINTS = 1000, 300  # samples and, per incidence, directions that the estimate is made of
FLOOR = 0.01
AROUND, MISSED_OF = 8, 2000  # samples that say how rough it is at a place, of so many
SMOOTHEST, LARGEST_MISS = 0.02, 2.0


class RunningBrdf(Sampled):
    """Patches asked directly: right for hundreds of pairs at a time, not for rendering. Not saved."""

    def __init__(self, problem: Problem, stretch: Coordinates, held_out: float):
        self.problem, self.stretch, self._held_out = problem, stretch, held_out
        self.frame, self.t0, self.channels = problem.frame, stretch.t0, problem.g.shape[1]
        self._x = stretch(problem.angles)
        self._patches = Patches(self._x, problem.y, problem.variance)
        self._floor = FLOOR * problem.ratio.floor

    @cached_property
    def energy_error_estimate(self) -> float:
        """The energy error to be expected over the whole domain; worked out when first asked for."""
        p = self.problem
        looked, said, relative = self._without_themselves
        half, b = self.posterior.held_out_sd(relative), p.b[looked]
        spans = p.ratio.inverse(said + half, b) - p.ratio.inverse(said - half, b)
        there = EnergyError(p.angles, p.g, p.sigma, self.stretch, looked).of_errors(MEAN_OVER_68 * 0.5 * spans)
        scale = float(np.clip(self._held_out / max(there, 1e-12), *TRUSTED))
        return scale * expected_error(self.eval, self.interval, POINTS)

    @cached_property
    def posterior(self) -> Posterior:
        p = self.problem
        looked, said, relative = self._without_themselves
        v = solid_angles(self.stretch, p.angles, looked)
        return Posterior.of(self._x, p.y, p.variance, looked, said, relative, v)

    @cached_property
    def _without_themselves(self):
        """Some samples (indices), what the others say they are (M, C), and with what relative variance (M,)."""
        p = self.problem
        rng = np.random.default_rng(0)
        looked = rng.permutation(len(p.samples))[:LOOKED_AT]
        said, relative = left_out_with_variance(self._x, p.y, p.variance, looked)
        if len(p.samples) <= FEW:
            said, relative = (v[looked] for v in said_by_others(p, self.stretch, rng))
        return looked, said, relative

    def interval(self, wi: Array, wo: Array) -> tuple[Array, Array]:
        """(low, high), (N, C) each, in 1/sr: 68 % of true values lie between; pairs above the horizon."""
        p = self.problem
        a = p.frame.angles(wi, wo)
        x, b = self.stretch(a), p.base(a)
        y, sd = self._patches(x), self.posterior.sd(x)
        low, high = (p.ratio.inverse(y + s * sd, b) / a.cos_o[:, None] for s in (-1, 1))
        return low, high

    def std(self, wi: Array, wo: Array) -> Array:
        """Half the width of that interval, (N, C)."""
        low, high = self.interval(wi, wo)
        return 0.5 * (high - low)

    @property
    def held_out(self) -> float:
        """The energy error of samples that were held out: relative, where samples are."""
        return self._held_out

    @property
    def dimensions(self) -> int:
        return self.stretch.dimensions

    def coordinates(self, wi: Array, wo: Array) -> Array:
        """(N, d): those in which the residual is smooth."""
        return self.stretch(self.frame.angles(wi, wo))

    def measure(self, wi: Array, wo: Array) -> Array:
        """|dwi dwo| per volume of the coordinates, (N,), up to a constant."""
        return self.stretch.measure(self.frame.angles(wi, wo))

    def roughness(self, wi: Array, wo: Array) -> Array:
        """By how much samples around are missed by their neighbours, (N,), in y; never 0."""
        square, tree = self._missed
        count = min(AROUND, len(square))
        _, near = tree.query(self.coordinates(wi, wo), count)
        return np.sqrt(square[near.reshape(-1, count)].mean(1)) + SMOOTHEST

    @cached_property
    def _missed(self) -> tuple[Array, cKDTree]:
        """Mean squares (M,) by which samples are missed without themselves, and where they lie."""
        p = self.problem
        looked = np.random.default_rng(0).permutation(len(p.samples))[:MISSED_OF]
        error = np.minimum(np.abs(left_out(self._x, p.y, p.variance, looked) - p.y[looked]), LARGEST_MISS)
        return (error**2).mean(1), cKDTree(self._x[looked])

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
    for t0 in (width, 4 * width):
        stretch = frame.stretch(t0)
        tried[stretch] = error(p.ratio.inverse(left_out(stretch(p.angles), p.y, p.variance, test), p.b[test]))
    best = min(tried, key=lambda k: tried[k])
    return RunningBrdf(p, best, tried[best])
