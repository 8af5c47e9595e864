"""Mirror symmetry, f(wi, wo) = f of their mirror image: a hypothesis about how the sample lay, so the data are asked.

An isotropic sample shows the same at +phi and -phi, at any turn of the table. It does not seem to where its normal was
not where the rig believed (a tilt), or where the azimuths of light and detector do not begin together. Folding such
readings onto each other makes neighbours that contradict. So three angles are sought under which samples predict each
other best: tilts about x and y (of wi and wo alike), and an azimuth of wo alone; the correction is taken where
held-out samples confirm it, and what contradiction is left is counted in the error.
"""

from dataclasses import dataclass, replace

import numpy as np

from gonio.geometry import Array, unit
from gonio.reconstruct.samples import Samples
from gonio.reconstruct.splines.held_out import energy_weights, solid_angles
from gonio.reconstruct.splines.patches import left_out
from gonio.reconstruct.splines.robust_base import RobustBase

GAIN = 0.85  # the error with the correction over that without: below this it is taken
SURELY = 0.6  # the same, where the two sides do not contradict each other: samples in one plane cannot
SEEN = 0.02  # share of the energy by which sides have to differ to be called different
CLEARLY = 0.95  # the same, for whether a cosine is to be divided out anew
TESTED, AMONG = 300, 3000
PRIOR_DEG = np.array([2.0, 2.0, 5.0])  # how far off a rig may be: what data do not tell stays at 0
LARGEST_DEG = np.array([5.0, 5.0, 15.0])
PRIOR = 0.02  # how much of the loss a deviation of PRIOR_DEG has to explain
# where a search may begin: a narrow peak is lost to one that begins elsewhere
STARTS_DEG = np.array(
    [[0, 0, a] for a in (-8, -6.5, -5, -4, -3, -2, -1, 1, 2, 3, 4, 5, 6.5, 8)]
    + [[a * x, a * y, 0] for a in (0.3, 1.0) for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))],
    float,
)
SEARCHED = 70
FEWEST = 50  # samples on either side that can tell
CHANCE = 1.2  # by how much two halves of the same may differ
APART = 1e3  # puts the two sides of the plane of incidence out of each other's reach


@dataclass(frozen=True)
class Alignment:
    """Tilts of the sample about its x and y axis and the azimuth of wo, degrees: what directions have to be turned by.

    cosine: whether readings were divided by the believed cos theta_i and are to be divided by the true one.
    """

    tilt_x: float = 0.0
    tilt_y: float = 0.0
    azimuth: float = 0.0
    cosine: bool = False

    @property
    def angles(self) -> Array:
        return np.array([self.tilt_x, self.tilt_y, self.azimuth])

    def turned(self, wi: Array, wo: Array) -> tuple[Array, Array]:
        """wi, wo (N, 3) in the frame of the true normal."""
        x, y, z = np.radians(self.angles)
        tilt = np.array([[1, 0, y], [0, 1, -x], [-y, x, 1]])
        about_z = np.array([[np.cos(z), -np.sin(z), 0], [np.sin(z), np.cos(z), 0], [0, 0, 1]])
        return unit(wi @ tilt.T), unit(wo @ about_z.T @ tilt.T)

    def applied(self, s: Samples) -> Samples:
        """The samples as they would have been read with everything in its place; those now below the horizon go."""
        wi, wo = self.turned(s.wi, s.wo)
        up = (wi[:, 2] > 1e-3) & (wo[:, 2] > 1e-3)
        scale = s.wi[:, 2:] / np.maximum(wi[:, 2:], 1e-3) if self.cosine else np.ones((len(s), 1))
        return replace(s, wi=wi, wo=wo, f=s.f * scale, sigma=s.sigma * scale)[up]


@dataclass(frozen=True)
class Symmetry:
    """How far the two sides differ, as a share of the energy, before and after `alignment`; error ratio of the two.

    turned: how far what is read with wi along x differs from that along y, after the alignment: a grain, if not 0.
    """

    alignment: Alignment
    before: float
    after: float
    turned: float
    ratio: float

    @property
    def left(self) -> float:
        """The share of the energy that one isotropic BRDF cannot have right: the mean lies half-way."""
        return 0.5 * float(np.hypot(self.after, self.turned))

    @property
    def corrected(self) -> bool:
        return bool(np.any(self.alignment.angles))

    def notes(self) -> dict[str, float]:
        """For the record of a reconstruction, angles in degrees."""
        a = self.alignment
        return {
            "mirror_asymmetry": self.before,
            "mirror_asymmetry_left": self.after,
            "turn_asymmetry": self.turned,
            "tilt_x_deg": a.tilt_x,
            "tilt_y_deg": a.tilt_y,
            "azimuth_deg": a.azimuth,
            "cosine_was_tilted": float(a.cosine),
            "error_with_alignment_over_without": self.ratio,
        }


def ask(problem, t0: float, rng: np.random.Generator) -> Symmetry:
    """Of a `Problem` of samples of an isotropic surface; t0 as in `Coordinates`, radians."""
    n = len(problem.samples)
    problem = problem.at(rng.permutation(n)[:AMONG]) if n > AMONG else problem
    view = _View(problem, t0, rng.permutation(len(problem.samples))[:TESTED])
    none = Alignment()
    before, alone = view.asymmetry(none), view.error(none)
    found = view.best([np.zeros(3), view.by_the_peak(), *STARTS_DEG], 0.4)
    error = view.error(found)
    if error < GAIN * alone:  # once more with more samples, and a base that was fitted to them in their place
        base = view.base_of(found, rng)
        finer = _View(replace(problem, base=base), t0, rng.permutation(len(problem.samples))[: 3 * TESTED])
        found = finer.best([found.angles], 0.1)
        error = view.error(found)
    with_cosine = replace(found, cosine=True)
    if (other := view.error(with_cosine)) < CLEARLY * error:
        found, error = with_cosine, other
    ratio, after = error / max(alone, 1e-12), view.asymmetry(found)
    contradicted = before > SEEN and after < before
    if ratio < SURELY or (ratio < GAIN and contradicted):
        if after <= max(before, SEEN):
            return Symmetry(found, before, after, view.turning(found), ratio)
    return Symmetry(none, before, before, view.turning(none), ratio)


class _View:
    """The samples as they predict each other under one alignment or another."""

    def __init__(self, problem, t0: float, test):
        self.problem, self.s, self.test = problem, problem.samples, test
        self.stretch = problem.frame.stretch(t0)
        v = solid_angles(self.stretch, problem.angles, test)
        self.weight = energy_weights(problem.angles.at(test), problem.g[test], v)
        energy = np.maximum(problem.g[test], 0) * self.weight
        self.say = np.sqrt(energy / max(energy.sum(), 1e-300))

    def _placed(self, a: Alignment):
        """Angles and g = f cos theta_o of all samples under an alignment."""
        wi, wo = a.turned(self.s.wi, self.s.wo)
        wi[:, 2], wo[:, 2] = np.maximum(wi[:, 2], 1e-3), np.maximum(wo[:, 2], 1e-3)
        angles = self.problem.frame.angles(wi, wo)
        scale = self.s.wi[:, 2] / wi[:, 2] if a.cosine else np.ones(len(wi))
        return angles, self.s.f * (scale * angles.cos_o)[:, None]

    def _seen(self, a: Alignment) -> tuple[Array, Array, Array]:
        """Coordinates, log ratio and base of all samples under an alignment."""
        angles, g = self._placed(a)
        b = self.problem.base(angles)
        return self.stretch(angles), self.problem.ratio.forward(g, b), b

    def residuals(self, degrees: Array) -> Array:
        """How far samples lie from what the others say, weighed by their energy, (tested x C,)."""
        x, y, _ = self._seen(Alignment(*degrees))
        gap = (y[self.test] - left_out(x, y, self.problem.variance, self.test)) * self.say
        limit = 3 * self.say  # a residual of 3 in the logarithm is no longer one of alignment
        return np.clip(gap, -limit, limit).ravel()

    def base_of(self, a: Alignment, rng: np.random.Generator) -> RobustBase:
        """The base of the samples as `a` places them."""
        angles, g = self._placed(a)
        return RobustBase.fit(angles, g, self.problem.ratio.floor, rng)

    def loss(self, degrees: Array) -> float:
        """Energy-weighted square of the residuals, with a prior on the three angles; what is out of range is worst."""
        if (np.abs(degrees) > LARGEST_DEG).any():
            return np.inf
        r = self.residuals(degrees)
        return float(r @ r) * (1 + PRIOR * float(np.sum((degrees / PRIOR_DEG) ** 2)))

    def best(self, starts: list[Array], reach: float) -> Alignment:
        """Downhill (Nelder & Mead 1965) from the best of `starts`, the first steps of `reach` degrees.

        Without derivatives: neighbourhoods change from one angle to the next, and with them the loss, in small steps.
        Where none of several starts is better than the first, the first is what it is.
        """
        from scipy.optimize import minimize

        losses = [self.loss(p) for p in starts]
        k = int(np.argmin(losses))
        if k == 0 and len(starts) > 1:
            return Alignment(*starts[0].tolist())
        simplex = starts[k] + reach * np.concatenate([np.zeros((1, 3)), np.eye(3)])
        options = {"initial_simplex": simplex, "maxfev": SEARCHED, "xatol": 0.02, "fatol": 0.01 * losses[k]}
        found = minimize(self.loss, starts[k], method="Nelder-Mead", options=options)
        return Alignment(*found.x.tolist())

    def by_the_peak(self) -> Array:
        """A start for a glossy sample, degrees: what brings the brightest half vectors to the normal.

        To first order a tilt moves every half vector by the same, an azimuth of wo by half its turn of wo.
        """
        bright = np.argsort(-(self.s.f / np.maximum(self.s.f.mean(0), 1e-300)).sum(1))[: max(20, len(self.s) // 20)]
        wi, wo = self.s.wi[bright], self.s.wo[bright]
        h = unit(wi + wo)
        across = np.stack([-wo[:, 1], wo[:, 0]], 1) / np.linalg.norm(wi + wo, axis=1, keepdims=True)
        ones, none = np.ones(len(bright)), np.zeros(len(bright))
        moved_x = np.stack([none, ones, across[:, 0]], 1)
        moved_y = np.stack([-ones, none, across[:, 1]], 1)
        columns, target = np.concatenate([moved_x, moved_y]), -np.concatenate([h[:, 0], h[:, 1]])
        say = np.ones(len(target))
        prior = np.diag(1 / np.radians(PRIOR_DEG))
        for _ in range(8):  # reweighted: half vectors far off are of a broad lobe, not of the peak's place
            width = np.median(np.abs(target * say)) + 1e-4
            weighted = np.concatenate([columns * say[:, None] / width, prior])
            found = np.linalg.lstsq(weighted, np.concatenate([target * say / width, np.zeros(3)]), rcond=None)[0]
            say = 1 / np.sqrt(1 + ((target - columns @ found) / width) ** 2)
        return np.clip(np.degrees(found), -LARGEST_DEG, LARGEST_DEG)

    def error(self, a: Alignment) -> float:
        """Energy error of samples predicted by the others."""
        x, y, b = self._seen(a)
        said = left_out(x, y, self.problem.variance, self.test)
        return self._difference(said, y[self.test], b[self.test])

    def asymmetry(self, a: Alignment) -> float:
        """The share of the energy by which the two sides of the plane of incidence differ."""
        wi, wo = a.turned(self.s.wi, self.s.wo)
        return self._apart(a, np.sign(wi[:, 0] * wo[:, 1] - wi[:, 1] * wo[:, 0]))

    def turning(self, a: Alignment) -> float:
        """The same between wi within 45 degrees of the x axis and the others; 0 where the table was not turned."""
        return self._apart(a, np.where(np.abs(self.s.wi[:, 0]) > np.abs(self.s.wi[:, 1]), 1.0, -1.0))

    def _apart(self, a: Alignment, side: Array) -> float:
        """By how much two kinds of samples, side (N,) = -1 or 1, differ beyond what samples of one kind differ by."""
        x, y, b = self._seen(a)
        t = self.test
        if min(np.count_nonzero(side > 0), np.count_nonzero(side < 0)) < FEWEST:
            return 0.0
        n = np.arange(len(t)) + len(x)
        both = np.concatenate([x, x[t]])
        values, variance = np.concatenate([y, y[t]]), np.concatenate([self.problem.variance, self.problem.variance[t]])
        own = np.column_stack([x, APART * side])
        other = np.column_stack([both, APART * np.concatenate([side, -side[t]])])
        across = self._difference(left_out(other, values, variance, n), y[t], b[t])
        along = self._difference(left_out(own, y, self.problem.variance, t), y[t], b[t])
        return float(np.sqrt(max(across**2 - (CHANCE * along) ** 2, 0.0)))

    def _difference(self, said: Array, y: Array, b: Array) -> float:
        inverse = self.problem.ratio.inverse
        return float((np.abs(inverse(said, b) - inverse(y, b)) * self.weight).sum())
