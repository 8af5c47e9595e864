"""The default reconstruction, on truths of known form."""

import numpy as np

from gonio.brdf import Ggx, Lambert, Mixture
from gonio.geometry import from_angles
from gonio.reconstruct import Samples, reconstruct


def test_first_light():
    truth = Mixture([Lambert([0.1, 0.2, 0.3]), Ggx(0.2, weight=[0.5, 0.5, 0.5])])
    rng = np.random.default_rng(0)
    wi = from_angles(np.arccos(rng.random(1500)), 2 * np.pi * rng.random(1500))
    wo, _ = truth.sample(wi, rng.random((1500, 2)))
    keep = wo[:, 2] > 0
    wi, wo = wi[keep], wo[keep]
    got = reconstruct(Samples.of(wi, wo, truth.eval(wi, wo)))
    value, want = got.eval(wi[:200], wo[:200]), truth.eval(wi[:200], wo[:200])
    assert np.median(np.abs(value / want - 1)) < 0.02
