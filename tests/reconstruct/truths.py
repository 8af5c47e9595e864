"""Truths of known form, and samples of them as a good acquisition gives them."""

from functools import partial

import numpy as np

from gonio.bench.speed.reconstruction_speed import brushed_error
from gonio.brdf import Beckmann, Ggx, Lambert, Mixture
from gonio.geometry import Array, from_angles
from gonio.reconstruct import Samples

GLOSSY = Mixture([Ggx(0.08, weight=[0.5, 0.4, 0.3]), Lambert([0.05, 0.2, 0.4])])
BRUSHED = Mixture([Ggx(0.3, 0.03, weight=[0.5, 0.4, 0.3]), Lambert([0.05, 0.2, 0.4])])
BECKMANN = Mixture([Beckmann(0.05, 0.2, weight=[0.5, 0.4, 0.3]), Lambert([0.05, 0.2, 0.4])])


class OneWay:
    """A truth that breaks reciprocity by 30 %, as films do."""

    channels = 3
    sample, pdf = GLOSSY.sample, GLOSSY.pdf

    def eval(self, wi: Array, wo: Array) -> Array:
        return GLOSSY.eval(wi, wo) * (1 + 0.3 * np.tanh(3 * (wi[:, 2:] - wo[:, 2:])))


def pairs(truth, n: int, seed: int = 0) -> tuple[Array, Array]:
    """n pairs above the horizon: three quarters by the truth's own sampler, the rest uniform."""
    rng = np.random.default_rng(seed)
    m = 2 * n
    wi = from_angles(np.arccos(rng.random(m)), 2 * np.pi * rng.random(m))
    wo, _ = truth.sample(wi, rng.random((m, 2)))
    uniform = rng.random(m) < 0.25
    wo[uniform] = from_angles(np.arccos(rng.random(m)), 2 * np.pi * rng.random(m))[uniform]
    up = (wi[:, 2] > 1e-3) & (wo[:, 2] > 1e-3)
    return wi[up][:n], wo[up][:n]


def samples(truth, n: int, seed: int = 0) -> Samples:
    """With the noise of a good detector: half a percent and a read noise."""
    wi, wo = pairs(truth, n, seed)
    f = truth.eval(wi, wo)
    sigma = np.hypot(0.005 * f, 3e-5 / wi[:, 2:])
    return Samples.of(wi, wo, f + sigma * np.random.default_rng(seed + 1).standard_normal(f.shape), sigma)


energy_error = partial(brushed_error, n=1500)
