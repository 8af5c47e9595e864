"""The prior over materials: what it says of few samples, that it helps, and that a bad file is named."""

import numpy as np
import pytest

from gonio.bench.accuracy.prior import Config, random_material, run
from gonio.bench.drive import drive, truth_of
from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.evaluate import evaluate
from gonio.geometry import to_half_diff
from gonio.load import load_brdf, save_brdf
from gonio.reconstruct import Samples, reconstruct
from gonio.reconstruct.prior import PriorError, blend, shipped
from gonio.reconstruct.prior.materials import EPS, NODES, Materials, chart, nodes
from gonio.reconstruct.splines.robust_base import Angles
from gonio.reconstruct.tables.lookup import Lookup
from gonio.run.prepare import prepare

IDEAL = load_config(find_config("ideal", "rigs"), RigConfig)


def angles(n, seed):
    rng = np.random.default_rng(seed)
    theta = np.pi / 2 * rng.random((2, n)) ** 0.5 * 0.95
    phi = np.pi * rng.random(n)
    wi = np.stack([np.sin(theta[0]), 0 * phi, np.cos(theta[0])], 1)
    wo = np.stack([np.sin(theta[1]) * np.cos(phi), np.sin(theta[1]) * np.sin(phi), np.cos(theta[1])], 1)
    return Angles.of(wi, wo)


def read(log, a):
    """A table (n,) of logarithms at the angles, (N, 1)."""
    return Lookup(log.reshape(*NODES, -1), (False,) * 3, (1, 1, 1))(chart(a))


@pytest.mark.parametrize("s", [1e-6, 0.3, 1e5])
def test_a_material_of_the_prior_is_found_again(s):
    m = shipped()
    z = np.random.default_rng(3).standard_normal(len(m.components))
    log = m.mean + z @ m.components
    a, elsewhere = angles(80, 1), angles(2000, 2)
    g = s * (np.exp(read(log, a)) - EPS) / a.cos_i[:, None]
    table, _ = m.table_of(a, g, 0.01 * np.abs(g))
    off = read(table[:, 0], elsewhere) - np.log(s) - read(log, elsewhere)
    assert np.sqrt(np.mean(off**2)) < 0.25
    alone = read(m.mean - log, elsewhere)  # the mean of all materials, scaled, is no such answer
    assert np.std(alone) > 2 * np.sqrt(np.mean(off**2))


def test_the_chart_folds_at_reciprocity_and_holds_the_horizon():
    theta_h, theta_d, phi_d = nodes()
    c = np.full(len(theta_h), 0.5)
    assert np.allclose(
        chart(Angles(theta_h, theta_d, phi_d, c, c)), chart(Angles(theta_h, theta_d, np.pi - phi_d, c, c))
    )
    below = np.cos(theta_h) * np.cos(theta_d) < np.sin(theta_h) * np.sin(theta_d) * np.cos(phi_d)
    assert below.sum() > 1000 and np.allclose(shipped().mean[below], np.log(EPS), atol=0.01)


SATIN = Mixture([Lambert([0.2, 0.1, 0.3]), Ggx(0.2, None, [0.3, 0.3, 0.3])])


class Drawn:
    """One of the random materials that the prior is made of, of another seed."""

    channels = 1

    def __init__(self, seed):
        self.f = random_material(np.random.default_rng(seed))

    def eval(self, wi, wo):
        theta_h, _, theta_d, _ = to_half_diff(wi, wo)
        return self.f(theta_h, theta_d, wi, wo)[:, None]


def test_few_samples_are_worth_more_with_it(monkeypatch):
    ratio = []
    for seed in range(100, 106):
        truth = Drawn(seed)
        d = drive(truth, {"proposal": "auto"}, 24)
        s = Samples.of(d.wi[:24], d.wo[:24], d.f[:24])
        made = evaluate(reconstruct(s), truth, 2000)["energy_mean"]
        with monkeypatch.context() as m:
            m.setattr(blend, "WORTH", 0.0)
            ratio.append(made / evaluate(reconstruct(s), truth, 2000)["energy_mean"])
    assert np.exp(np.mean(np.log(ratio))) < 0.95, ratio


def test_it_is_saved_with_the_brdf_and_left_out_where_there_is_enough(tmp_path):
    truth = SATIN
    d = drive(truth, {"proposal": "auto"}, 500)
    wi, wo = d.wi[-200:], d.wo[-200:]
    for count, has in ((40, True), (500, False)):
        brdf = reconstruct(Samples.of(d.wi[:count], d.wo[:count], d.f[:count]))
        save_brdf(brdf, tmp_path / "brdf.npz")
        with np.load(tmp_path / "brdf.npz") as file:
            assert ("prior" in file.files) == has
        again = load_brdf(tmp_path / "brdf.npz")
        assert np.allclose(again.eval(wi, wo), brdf.eval(wi, wo), rtol=1e-5)
        assert np.allclose(again.std(wi, wo), brdf.std(wi, wo), rtol=1e-4)


@pytest.mark.parametrize("channels", [1, 7])
def test_any_number_of_channels_and_dark_ones(channels):
    d = drive(SATIN, {"proposal": "auto"}, 40)
    f = np.repeat(d.f[:, :1], channels, 1) * np.geomspace(1e-300, 1, channels)
    f[:, 0] = 0 if channels > 1 else f[:, 0]
    brdf = reconstruct(Samples.of(d.wi[:40], d.wo[:40], f[:40]))
    got = brdf.eval(d.wi, d.wo)
    assert got.shape == (len(d.wi), channels) and np.isfinite(got).all() and (got >= 0).all()


def test_a_file_that_is_none_is_named(tmp_path, monkeypatch):
    for name, arrays in (
        ("a.npz", {"x": np.zeros(3)}),
        ("b.npz", {"mean": np.zeros(5), "components": np.zeros((2, 5))}),
    ):
        np.savez(tmp_path / name, **arrays)
        monkeypatch.setenv("GONIO_PRIOR", str(tmp_path / name))
        with pytest.raises(PriorError, match=rf"{name}: .*gonio bench prior"):
            shipped()
        with pytest.raises(PriorError):  # before anything is measured
            prepare(Material.model_validate({"name": "x", "truth": "analytic_gloss"}), IDEAL, tmp_path / "run")


def test_the_study_makes_one(tmp_path):
    rng = np.random.default_rng(0)
    names = ["dtu/x_one", "merl/y_two", "rgl-isotropic/cc_three_rgb"]
    np.savez(tmp_path / "nets.npz", names=names, weights=0.1 * rng.standard_normal((3, 675)))
    said = []
    config = Config(study="prior", archive=str(tmp_path / "nets.npz"), networks="strange", lobes=12, components=5)
    run(config, tmp_path, said.append)
    assert "x_one" in said[0] and "y_two" not in said[0] and "three" not in said[0]
    with np.load(tmp_path / "materials.npz") as d:
        made = Materials(d["mean"].astype(float), d["components"].astype(float))
    a = angles(30, 1)
    table, s = made.table_of(a, a.cos_o[:, None] * 0.3, np.zeros((30, 1)))
    assert table.shape == (64 * 32 * 10, 1) and np.isfinite(table).all() and s[0] > 0


def test_nothing_grows_towards_the_horizon():
    """The table's cells reach across it, where cosines are divided by: f was 9.0 in place of 0.37 at 89.9 degrees."""
    truth = truth_of("analytic_gloss")
    d = drive(truth, {"proposal": "auto"}, 24)
    brdf = reconstruct(Samples.of(d.wi[:24], d.wo[:24], d.f[:24]))
    steep = np.radians([88.0, 89, 89.5, 89.9])
    wi = np.stack([np.sin(steep), 0 * steep, np.cos(steep)], 1)
    for wo in (wi @ np.diag([-1, 1, 1.0]), wi[:, [1, 0, 2]], np.tile([0.6, 0, 0.8], (4, 1))):
        for a, b in ((wi, wo), (wo, wi)):
            assert (brdf.eval(a, b) < 8 * truth.eval(a, b)).all()
