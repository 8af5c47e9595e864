"""The default reconstruction: a robust base, and the log ratio to it interpolated by overlapping thin-plate splines."""

import numpy as np

from gonio.brdf.half_sampler import HalfSampler
from gonio.geometry import Array, from_angles
from gonio.reconstruct.clean import clean
from gonio.reconstruct.held_out import energy_weights, solid_angles
from gonio.reconstruct.patches import Patches, left_out
from gonio.reconstruct.residual import LogRatio
from gonio.reconstruct.robust_base import Angles, RobustBase
from gonio.reconstruct.samples import Samples
from gonio.reconstruct.stretch import Stretch


class AutoBrdf:
    kind = "auto"

    def __init__(self, base, log_ratio, stretch, patches, energy_error_estimate):
        self.base, self.log_ratio, self.stretch, self.patches = base, log_ratio, stretch, patches
        self.energy_error_estimate = energy_error_estimate
        edges = np.concatenate([[0], np.geomspace(1e-3, np.pi / 2, 64)])
        middle = (edges[1:] + edges[:-1]) / 2
        lobe = self.eval(from_angles(middle, 0 * middle), from_angles(middle, 0 * middle)).mean(1)
        self._sampler = HalfSampler(edges, lobe * np.sin(2 * middle) * np.diff(edges))

    @property
    def channels(self) -> int:
        return self.base.weights.shape[1]

    def eval(self, wi: Array, wo: Array) -> Array:
        wi, wo = np.atleast_2d(np.asarray(wi, float)), np.atleast_2d(np.asarray(wo, float))
        out = np.zeros((len(wi), self.channels))
        up = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        if up.any():
            a = Angles.of(wi[up], wo[up])
            b = self.base(a)
            out[up] = self.log_ratio.inverse(self.patches(self.stretch(a)), b) / a.cos_o[:, None]
        return out

    def sample(self, wi: Array, u: Array) -> tuple[Array, Array]:
        return self._sampler.sample(wi, u)

    def pdf(self, wi: Array, wo: Array) -> Array:
        return self._sampler.pdf(wi, wo)


def fit(samples: Samples, *, anisotropic: bool, rng: np.random.Generator) -> AutoBrdf:
    s = clean(samples)
    s = s[~s.saturated]
    a = Angles.of(s.wi, s.wo)
    g, sigma = s.f * a.cos_o[:, None], s.sigma * a.cos_o[:, None]
    ratio = LogRatio.of(g, sigma)
    base = RobustBase.fit(a, g, ratio.floor, rng)
    b = base(a)
    y, variance = ratio.forward(g, b), ratio.variance(g, sigma, b)
    test = rng.choice(len(s), min(len(s), 800), replace=False)
    first = Stretch(peak_width(a, g))
    weight = energy_weights(a.at(test), g[test], solid_angles(first, a)[test])

    def error(stretch: Stretch) -> float:
        said = ratio.inverse(left_out(stretch(a), y, variance, test), b[test])
        return float((np.abs(said - g[test]) * weight).sum())

    tried = {stretch: error(stretch) for stretch in [Stretch(t0) for t0 in first.t0 * np.geomspace(1/8,8,7)]}
    best = min(tried, key=lambda k: tried[k])
    for azimuth, elevation in OPTS:
        stretch = Stretch(best.t0, azimuth, elevation); tried[stretch] = error(stretch)
    best = min(tried, key=lambda k: tried[k])
    return AutoBrdf(base, ratio, best, Patches(best(a), y, variance), tried[best])
OPTS=((0.5,0.55),(1.0,0.55),(0.7,0.35),(0.7,0.8))

def peak_width(a: Angles, g: Array) -> float:
    bright = np.argsort(-(g/g.mean(0)).sum(1))[:max(10, len(g)//20)]
    return float(np.clip(np.median(a.theta_h[bright]), 0.004, 1.0))
