"""The default reconstruction: a robust base, and the log ratio to it predicted by local Gaussian processes.

samples -> clean -> base (lobes, log loss) -> log ratio -> coordinates chosen by held-out energy error -> patches
-> table, and its standard deviation. Every choice is made by predicting samples from their neighbours; nothing is tuned
to a material.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from gonio.geometry import Array, directions
from gonio.reconstruct.clean import clean
from gonio.reconstruct.errors import ReconstructionError
from gonio.reconstruct.prior.blend import Base, Blend
from gonio.reconstruct.samples import Samples
from gonio.reconstruct.splines import symmetry
from gonio.reconstruct.splines.expected_error import MEAN_OVER_68, expected_error
from gonio.reconstruct.splines.few import FEW, FEWEST, said_by_others
from gonio.reconstruct.splines.frame import Coordinates, Frame, PairAngles
from gonio.reconstruct.splines.grain import Grain
from gonio.reconstruct.splines.held_out import EnergyError, solid_angles
from gonio.reconstruct.splines.isotropic import Isotropic
from gonio.reconstruct.splines.outliers import outliers
from gonio.reconstruct.splines.patches import Patches, left_out, left_out_with_variance
from gonio.reconstruct.splines.posterior import WIDTHS, Posterior, width
from gonio.reconstruct.splines.reciprocity import holds, mirrored
from gonio.reconstruct.splines.residual import LogRatio
from gonio.reconstruct.splines.robust_base import RobustBase
from gonio.reconstruct.splines.symmetry import Alignment
from gonio.reconstruct.tables.lookup import Lookup
from gonio.reconstruct.tables.tabulate import TabulatedBrdf

TESTED = 600
CHOOSING = 30_000
LOOKED_AT = 3000
WIDTHS_OF_PEAK = np.geomspace(1 / 8, 8, 7)
LIFTED = 0.3  # sd: where less is known than that, the median has the smaller error
TRUSTED = (0.4, 4.0)  # how far held-out samples may scale what the posterior expects


class AutoBrdf:
    """The BRDF of `fit`, tabulated. Beyond `Brdf`: `std`, `interval`, `energy_error_estimate`, and `notes`.

    energy_error_estimate: the share of the reflected energy expected in the wrong place or amount, mean over theta_i
    and channels (the referee's energy_mean): over the whole domain, from the posterior; no truth is needed.
    notes: how it was made.
    """

    kind = "auto"

    def __init__(
        self, table: TabulatedBrdf, spread: Lookup, widths: Array, energy_error_estimate: float, notes: dict[str, float]
    ):
        self.table, self.spread, self.widths, self.notes = table, spread, widths, notes
        self.energy_error_estimate = energy_error_estimate
        self.eval, self.sample, self.pdf = table.eval, table.sample, table.pdf

    @property
    def channels(self) -> int:
        return self.table.channels

    def std(self, wi: Array, wo: Array) -> Array:
        """Standard deviation of `eval` in 1/sr, (N, C): half the width of the interval of 68 %. 0 below the horizon."""
        low, high = self.interval(wi, wo, 0.6827)
        return 0.5 * (high - low)

    def interval(self, wi: Array, wo: Array, level: float) -> tuple[Array, Array]:
        """(low, high), (N, C) each, in 1/sr, between which the true f lies with probability `level`, in (0, 1).

        Both are 0 below the horizon. Raises ValueError for another level.
        """
        if not 0 < level < 1:
            raise ValueError(f"level must lie between 0 and 1, not {level}")
        wi, wo = directions(wi), directions(wo)
        low, high = np.zeros((2, len(wi), self.channels))
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        if up.any():
            a = self.table.frame.angles(wi[up], wo[up])
            at, ratio, base = self.table.chart(a), self.table.ratio, self.table.base(a)
            sd = self.spread(at)
            middle, half = self.table.table(at) - self._lift(sd), width(self.widths, level) * sd
            cos_o = a.cos_o[:, None]
            low[up] = ratio.inverse(middle - half, base) / cos_o
            high[up] = ratio.inverse(middle + half, base) / cos_o
        return low, high

    def _lift(self, sd: Array) -> Array:
        return lift(sd) if self.notes.get("lifted", 1.0) else np.zeros_like(sd)

    @property
    def alignment(self) -> Alignment:
        """How the directions of the readings were turned to have the sample in its place; `eval` takes turned ones."""
        x, y, azimuth = (self.notes.get(k, 0.0) for k in ("tilt_x_deg", "tilt_y_deg", "azimuth_deg"))
        return Alignment(x, y, azimuth, bool(self.notes.get("cosine_was_tilted", 0.0)))

    def to_arrays(self) -> dict[str, Array]:
        notes = {f"note.{k}": np.array(v, float) for k, v in self.notes.items()}
        own = {"spread": self.spread.values, "energy_error_estimate": np.array(self.energy_error_estimate)}
        own["widths"] = np.asarray(self.widths)
        return self.table.to_arrays() | own | notes

    @classmethod
    def from_arrays(cls, d: dict[str, Array]) -> "AutoBrdf":
        notes = {k[5:]: float(v) for k, v in d.items() if k.startswith("note.")}
        table = TabulatedBrdf.from_arrays(d)
        spread = Lookup(d["spread"], table.chart.periodic, (1,) * len(table.chart.periodic))
        return cls(table, spread, d.get("widths", WIDTHS), float(d["energy_error_estimate"]), notes)


@dataclass(frozen=True)
class Problem:
    """What is to be interpolated: log ratio y (N, C) of noise variance (N,) at `angles`, from g and sigma (N, C)."""

    samples: Samples
    frame: Frame
    angles: PairAngles
    g: Array
    sigma: Array
    ratio: LogRatio
    base: Base
    b: Array
    y: Array
    variance: Array

    @classmethod
    def of(cls, s: Samples, frame: Frame, rng: np.random.Generator, prior_weight: float | None = None) -> "Problem":
        """prior_weight: that of the prior in the base; None = by held-out samples."""
        a = frame.angles(s.wi, s.wo)
        g, sigma = s.f * a.cos_o[:, None], s.sigma * a.cos_o[:, None]
        ratio = LogRatio.of(g, sigma)
        base = Blend.over(RobustBase.fit(a, g, ratio.floor, rng, sigma), a, g, sigma, ratio.floor, prior_weight)
        b = base(a)
        return cls(s, frame, a, g, sigma, ratio, base, b, ratio.forward(g, b), ratio.variance(g, sigma, b))

    def at(self, index) -> "Problem":
        """The same of the samples at `index`: base and floor are those of all."""
        per_sample = {k: getattr(self, k)[index] for k in ("samples", "g", "sigma", "b", "y", "variance")}
        return replace(self, angles=self.angles.at(index), **per_sample)


@dataclass(frozen=True)
class Splines:
    """What is tabulated: log_ratio(angles) -> (N, C) to the base, and its standard deviation as a table over the chart.

    t0 in radians; widths, notes: as `AutoBrdf` has them. held_out: the energy error at samples predicted from the
    others, and what the posterior expects there; seen(said) -> that of a log ratio `said` at the samples themselves.
    """

    frame: Frame
    base: Base
    ratio: LogRatio
    t0: float
    log_ratio: Callable[[PairAngles], Array]
    spread: Lookup
    widths: Array
    held_out: tuple[float, float]
    contradiction: float
    seen: Callable[[Callable[[PairAngles], Array]], float]
    notes: dict[str, float]


def fit(samples: Samples, *, anisotropic: bool, rng: np.random.Generator) -> AutoBrdf:
    """Raises ReconstructionError for samples too few or too poor."""
    s = splines(samples, anisotropic=anisotropic, rng=rng)
    table = TabulatedBrdf.of(s.frame, s.base, s.ratio, s.t0, s.log_ratio)
    made = AutoBrdf(table, s.spread, s.widths, 0.0, s.notes)
    found, expected = s.held_out
    # what is delivered is the table: where it smooths away what the patches follow, that is an error too
    missed = s.seen(lambda a: table.table(table.chart(a)))
    scale = float(np.clip(max(found, missed) / max(expected, 1e-12), *TRUSTED))
    whole = scale * expected_error(made.eval, lambda wi, wo: made.interval(wi, wo, 0.6827))
    made.energy_error_estimate = float(np.hypot(whole, s.contradiction))
    return made


def splines(samples: Samples, *, anisotropic: bool, rng: np.random.Generator) -> Splines:
    """Raises ReconstructionError for samples too few or too poor."""
    s = clean(samples)
    bounds, s = s[s.saturated], s[~s.saturated]
    frame: Frame = Grain.of(s.wi, s.wo, np.maximum(s.f, 0)) if anisotropic else Isotropic()
    p = Problem.of(s, frame, rng)
    enough = len(s) >= FEWEST
    wrong = np.zeros(len(s), bool)
    if enough:
        wrong = outliers(frame.stretch(peak_width(p))(p.angles), p.y, rng)
    if wrong.any():
        s = s[~wrong]
        if not (s.f > 0).any():
            raise ReconstructionError(
                f"all {wrong.sum()} readings above zero stand alone among {len(s)} that are not; check light and range"
            )
        p = Problem.of(s, frame, rng)
    mirror = None if anisotropic or not enough else symmetry.ask(p, peak_width(p), rng)
    if mirror is not None and mirror.corrected:
        s, bounds = mirror.alignment.applied(s), mirror.alignment.applied(bounds)
        p = Problem.of(s, frame, rng)
    few = p if len(s) <= CHOOSING else Problem.of(s[rng.permutation(len(s))[:CHOOSING]], frame, rng)
    stretch = chosen_stretch(few, rng)
    x, y, variance = stretch(p.angles), p.y, p.variance
    reciprocal, gain = holds(few, stretch, rng)
    if reciprocal:
        more = mirrored(p, stretch)
        x, y, variance = (np.concatenate(pair) for pair in zip((x, y, variance), more))
    if len(bounds):
        x, y, variance = with_bounds(p, stretch, bounds, x, y, variance)
    patches = Patches(x, y, variance)
    looked = rng.permutation(len(s))[:LOOKED_AT]
    said, relative = left_out_with_variance(x, y, variance, looked)
    if len(s) <= FEW:
        said, relative = (v[looked] for v in said_by_others(p, stretch, rng, mirrored if reciprocal else None))
    v = solid_angles(stretch, p.angles, looked)
    posterior = Posterior.of(x, y, variance, looked, said, relative, v)
    energy_error = EnergyError(p.angles, p.g, p.sigma, stretch, looked)
    b = p.b[looked]
    half = posterior.held_out_sd(relative)
    spans = p.ratio.inverse(said + half, b) - p.ratio.inverse(said - half, b)
    held_out = energy_error(p.ratio.inverse(said, b)), energy_error.of_errors(MEAN_OVER_68 * 0.5 * spans)
    chart = frame.chart(stretch.t0)
    nodes, _ = chart.nodes(chart.spread)
    sd = posterior.sd(stretch(nodes))
    known = Lookup(sd.reshape(*chart.spread, -1), chart.periodic, (1,) * len(chart.periodic))

    lifted = len(s) > FEW  # how far it lies above is a guess of few samples, and the median has the smaller error

    def mean_log_ratio(a: PairAngles) -> Array:
        return patches(stretch(a)) + (lift(known(chart(a))) if lifted else 0.0)

    notes = {
        "samples": len(s),
        "outliers": int(wrong.sum()),
        "saturated": len(bounds),
        "reciprocal": reciprocal,
        "error_with_reciprocity_over_without": gain,
        "t0": stretch.t0,
        "azimuth": stretch.azimuth,
        "elevation": stretch.elevation,
        "lifted": lifted,
    }
    if mirror is not None:
        notes |= mirror.notes()

    def seen(log_ratio: Callable[[PairAngles], Array]) -> float:
        return energy_error(p.ratio.inverse(log_ratio(p.angles.at(looked)), p.b[looked]))

    contradiction = 0.0 if mirror is None else mirror.left
    widths = posterior.widths / posterior.widths[0]
    return Splines(
        frame, p.base, p.ratio, stretch.t0, mean_log_ratio, known, widths, held_out, contradiction, seen, notes
    )


def lift(sd: Array) -> Array:
    """The logarithm's prediction is a median; the mean of a lognormal lies sd^2 / 2 above it."""
    return np.minimum(sd, LIFTED) ** 2 / 2


def chosen_stretch(p: Problem, rng: np.random.Generator) -> Coordinates:
    """The coordinates that predict held-out samples best."""
    test = rng.permutation(len(p.g))[:TESTED]
    first = p.frame.stretch(peak_width(p))
    error = EnergyError(p.angles, p.g, p.sigma, first, test)
    tried: dict[Coordinates, float] = {}

    def best(candidates: list[Coordinates]) -> Coordinates:
        for c in candidates:
            if c not in tried:
                tried[c] = error(p.ratio.inverse(left_out(c(p.angles), p.y, p.variance, test), p.b[test]))
        return min(tried, key=lambda c: tried[c])

    b = best([p.frame.stretch(t0) for t0 in first.t0 * (WIDTHS_OF_PEAK if len(p.g) >= FEWEST else WIDTHS_OF_PEAK[2:5])])
    b = best([p.frame.stretch(b.t0, azimuth, b.elevation) for azimuth in (0.5, 1.0)])
    b = best([p.frame.stretch(b.t0, b.azimuth, elevation) for elevation in (0.35, 0.8)])
    return b


def peak_width(p: Problem) -> float:
    """theta_h within which the brightest twentieth of the samples lies, by the median; radians."""
    bright = np.argsort(-(p.g / np.maximum(p.g.mean(0), 1e-300)).sum(1))[: max(10, len(p.g) // 20)]
    return float(np.clip(np.median(p.angles.theta_h[bright]), 0.004, 1.0))


def with_bounds(p: Problem, stretch: Coordinates, bounds: Samples, x: Array, y: Array, variance: Array):
    """x, y, variance with those saturated readings that the splines would fall short of put in at their bound."""
    a = p.frame.angles(bounds.wi, bounds.wo)
    least = p.ratio.forward(bounds.f * a.cos_o[:, None], p.base(a))
    said = Patches(x, y, variance)(stretch(a))
    short = (said < least).any(1)
    return (
        np.concatenate([x, stretch(a)[short]]),
        np.concatenate([y, np.maximum(said, least)[short]]),
        np.concatenate([variance, np.zeros(short.sum())]),
    )
