"""What is known of y everywhere: its standard deviation, growing with the distance to the data, and intervals.

    sd^2(q) = a(q) w (v(q) / w)^g + PRIOR u(q),   u = (v - r) / (1 - r) where v > r

v the relative variance of the prediction (`patches.relative_variance`: 0 at a noiseless sample, 1 far from all), a the
amplitude that held-out samples around q show, each by its squared residual over its own v, w their median v; g how
fast residuals really grow with v, from held-out samples whose nearest neighbours are held out with them. So where
samples are, sd is what held-out samples miss by; between them it grows as it is seen to grow; and far from all of them
it reaches what materials are known to differ by from a base that was fitted elsewhere (PRIOR). Intervals are not
normal: materials have tails. Their widths in units of sd are the quantiles of held-out samples and, where those are
few, of materials.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from gonio.geometry import Array
from gonio.reconstruct.splines.patches import left_out_with_variance, relative_variance

AROUND = 12  # held-out samples that say what the amplitude is
GLOBAL = 2.0  # samples that the amplitude of all of them is worth
MEDIAN = 0.455  # of the square of a normal variable
LEAST = 0.02  # of a squared residual that is more than noise
LARGEST = 4.0  # amplitude: beyond, it is a slip of one sample
PRIOR = (0.5, 1.5)  # least and largest
BELIEVED = 10.0  # times the mean square of y
REACH = 0.95  # the share of held-out samples up to whose v they are believed alone
FARTHEST = 1.2  # sd: a factor of three either way is what is known of materials without a sample
LEVELS = np.array([0.6827, 0.90, 0.95, 0.99])
WIDTHS = np.array([1.0, 1.9, 2.5, 4.2])  # of materials
WITHOUT, MEASURED = 6, 800  # neighbours held out besides, of so many samples
GROWTHS = (0.3, 2.0)
ENOUGH = 150.0  # held-out samples that the widths of materials are worth


@dataclass(frozen=True)
class Posterior:
    """x (N, d), y (N, C), variance (N,) of all samples; of the held-out ones: coordinates,
    squared residuals (M, C), relative variance and noise (M,)."""

    x: Array
    y: Array
    variance: Array
    held_out: Array
    square: Array
    relative: Array
    noise: Array
    growth: float
    typical: float
    reach: float
    prior: float
    widths: Array

    @classmethod
    def of(
        cls, x: Array, y: Array, variance: Array, at: Array, said: Array, relative: Array, solid_angles: Array
    ) -> "Posterior":
        """said (M, C), relative (M,): what samples `at` are predicted to be without themselves; solid_angles (M,):
        what each stands for, so that intervals hold for directions and not for where samples are dense."""
        noise = variance[at]
        square = np.minimum((said - y[at]) ** 2, LARGEST)
        few = at[:MEASURED]
        farther, v2 = left_out_with_variance(x, y, variance, few, without=WITHOUT)
        n = len(few)
        grown, first = (np.median(own(r**2, noise[:n])) for r in (farther - y[few], said[:n] - y[few]))
        step = np.median(np.log(v2 / relative[:n]))
        growth = float(np.clip(np.log(grown / first) / step, *GROWTHS)) if step > 0.05 and first > 0 else 1.0
        # a base that fits where it was asked is believed a little more where it was not
        prior = float(np.clip(BELIEVED * np.mean(y**2), *PRIOR))
        typical, reach = float(np.median(relative)), float(min(np.quantile(relative, REACH), 0.9))
        made = cls(x, y, variance, x[at], square, relative, noise, growth, typical, reach, prior, WIDTHS / WIDTHS[0])
        noise = noise[:, None]
        sd = np.sqrt(made.held_out_sd(relative) ** 2 + noise)
        z = np.abs(said - y[at]) / np.maximum(sd, 1e-12)
        weight = np.repeat(solid_angles[:, None], z.shape[1], 1)
        seen = weighted_quantiles(z.ravel(), weight.ravel(), LEVELS)
        share = len(at) / (len(at) + ENOUGH)
        widths = np.maximum.accumulate(share * seen + (1 - share) * WIDTHS)
        return replace(made, widths=widths)

    def sd(self, q: Array) -> Array:
        """Standard deviation of y at q (M, d), (M, C): 68 % of true values lie within one."""
        return self._sd(relative_variance(self.x, self.y, self.variance, q)[:, None], self._amplitude(q))

    def _sd(self, v: Array, amplitude: Array) -> Array:
        near = amplitude * self.typical * (v / self.typical) ** self.growth
        beyond = np.maximum(v - self.reach, 0) / (1 - self.reach)
        return np.minimum(self.widths[0] * np.sqrt(near + self.prior * beyond), FARTHEST)

    def held_out_sd(self, relative: Array) -> Array:
        """The same of the predictions of the held-out samples, whose relative variance is `relative` (M,), (M, C)."""
        return self._sd(relative[:, None], self._amplitude(self.held_out, 1))

    def _amplitude(self, q: Array, skip: int = 0) -> Array:
        """a at q (M, d), (M, C), by the held-out samples around, the first `skip` left out."""
        k = min(AROUND + skip, len(self.held_out))
        _, near = cKDTree(self.held_out).query(q, k)
        near = near.reshape(len(q), k)[:, min(skip, k - 1) :]
        # means first, then the noise: of single samples the difference is below 0 half of the time
        count = near.shape[1]
        square = self.square[near].mean(1) * count + GLOBAL * np.median(self.square, 0) / MEDIAN
        noise = (self.noise[near].mean(1) * count + GLOBAL * np.median(self.noise))[:, None]
        v = (self.relative[near].mean(1) * count + GLOBAL * self.typical)[:, None]
        return np.minimum(own(square, noise) / v, LARGEST)


def own(square: Array, noise: Array) -> Array:
    """Squared residuals (..., C) without the noise (...) in them, but never less than a share of what they are."""
    noise = noise[:, None] if noise.ndim < square.ndim else noise
    return np.maximum(square - noise, LEAST * square)


def weighted_quantiles(values: Array, weights: Array, levels: Array) -> Array:
    """Below which value the share `levels` of the weights lies."""
    order = np.argsort(values)
    share = np.cumsum(weights[order])
    return np.interp(levels, (share - 0.5 * weights[order]) / share[-1], values[order])


def width(widths: Array, level: float) -> float:
    """Widths (4,) at LEVELS, read at `level` in (0, 1): straight lines over the normal distribution's own."""
    from statistics import NormalDist

    normal = [NormalDist().inv_cdf(0.5 + 0.5 * x) for x in LEVELS]
    z = NormalDist().inv_cdf(0.5 + 0.5 * level)
    if z >= normal[-1]:
        return float(widths[-1] * z / normal[-1])
    return float(np.interp(z, [0.0, *normal], [0.0, *widths]))
