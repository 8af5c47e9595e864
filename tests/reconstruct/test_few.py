"""Few samples, and channels that are zero where others are not: a sane answer or a refusal, never nonsense."""

import numpy as np
import pytest

from gonio.bench.drive import drive
from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.evaluate import directions, evaluate
from gonio.geometry import to_half_diff
from gonio.reconstruct import ReconstructionError, Samples, reconstruct

MATERIALS = {
    "matt": Lambert([0.5, 0.3, 0.1]),
    "satin": Mixture([Lambert([0.2, 0.1, 0.3]), Ggx(0.2, None, [0.3, 0.3, 0.3])]),
    "glossy": Mixture([Lambert([0.1, 0.1, 0.1]), Ggx(0.04, None, [0.6, 0.4, 0.2])]),
    "mirror": Ggx(0.005, None, [0.9, 0.9, 0.9]),
}


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("count", [20, 35, 50])
def test_few_samples_never_make_nonsense(name, count):
    truth = MATERIALS[name]
    d = drive(truth, {"proposal": "auto"}, 50)
    s = Samples.of(d.wi[:count], d.wo[:count], d.f[:count])
    found = evaluate(reconstruct(s), truth)
    assert found["energy_mean"] < {"matt": 0.1, "satin": 0.6}.get(name, 1.3)
    assert found["bright_max"] < 2.5


def test_fewer_are_refused():
    d = drive(MATERIALS["satin"], {"proposal": "auto"}, 50)
    with pytest.raises(ReconstructionError, match="19 usable samples"):
        reconstruct(Samples.of(d.wi[:19], d.wo[:19], d.f[:19]))


class Clamped:
    """A film whose red is out of gamut, and clamped at 0, in the peak towards grazing; with a smooth edge."""

    channels = 3

    def __init__(self):
        self.film = Mixture([Lambert([0.2, 0.2, 0.2]), Ggx(0.08, None, [0.5, 0.5, 0.5])])

    def eval(self, wi, wo):
        f = self.film.eval(wi, wo)
        theta_h, _, theta_d, _ = (np.degrees(x) for x in to_half_diff(wi, wo))
        peak, steep = 1 / (1 + np.exp((theta_h - 2) / 0.2)), 1 / (1 + np.exp((60 - theta_d) / 2))
        left = 1 - peak * steep
        f[:, 0] *= np.where(left < 0.02, 0.0, left)
        return f


def test_a_channel_that_is_zero_in_part_of_the_peak():
    truth = Clamped()
    d = drive(truth, {"proposal": "auto"}, 1000)
    assert (d.f[:1000, 0] == 0).sum() > 3
    brdf = reconstruct(Samples.of(d.wi[:1000], d.wo[:1000], d.f[:1000]))
    errors, bright = [], []
    for wi, wo, weight, _ in directions(3000):
        got, want, w = brdf.eval(wi, wo), truth.eval(wi, wo), weight[:, None] * wo[:, 2:]
        errors.append((np.abs(got - want) * w).sum(0) / (want * w).sum(0))
        bright.append((got * w).sum(0) / (want * w).sum(0))
    steep = np.array(errors)[-2:]
    assert steep[:, 0].max() < 0.12 and steep[:, 1].max() < 0.08
    assert np.abs(np.array(bright) - 1).max() < 0.06


def test_what_the_others_say_of_a_sample_does_not_hang_on_it():
    """The base too is made without it; negative control: left out of the patches alone, it speaks through the base."""
    from gonio.reconstruct.splines.auto import Problem
    from gonio.reconstruct.splines.few import said_by_others
    from gonio.reconstruct.splines.isotropic import Isotropic
    from gonio.reconstruct.splines.patches import left_out

    truth, k, count = MATERIALS["satin"], 7, 40
    d = drive(truth, {"proposal": "auto"}, 50)
    honest, believing = [], []
    for factor in (1.0, 3.0):
        f = d.f[:count].copy()
        f[k] *= factor
        p = Problem.of(Samples.of(d.wi[:count], d.wo[:count], f), Isotropic(), np.random.default_rng(0), 0.3)
        stretch = p.frame.stretch(0.2)
        said, _ = said_by_others(p, stretch, np.random.default_rng(1))
        honest.append(p.ratio.inverse(said, p.b)[k])
        others = left_out(stretch(p.angles), p.y, p.variance, np.arange(count))
        believing.append(p.ratio.inverse(others, p.b)[k])
    assert np.allclose(honest[0], honest[1], rtol=1e-6)
    assert not np.allclose(believing[0], believing[1], rtol=1e-3)
