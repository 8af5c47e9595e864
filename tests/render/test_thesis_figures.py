"""The figures of the thesis on a tiny run: which can be made of what, and what they show."""

import numpy as np
import pytest

from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.config import ConfigError
from gonio.evaluate import directions
from gonio.reconstruct import Samples, reconstruct
from gonio.render.thesis import grids
from gonio.render.thesis.clouds import walk
from gonio.render.thesis.page import FIGURES, make_all, make_figure
from gonio.render.thesis.subject import Missing, Subject
from gonio.render.thesis.warped import WarpedSlices

TRUTH = Mixture([Lambert([0.3, 0.2, 0.1]), Ggx(0.2, None, [0.3, 0.2, 0.1])])
NUMBERS = [f"5.{k}" for k in range(1, 10)] + [f"6.{k}" for k in range(1, 8)]
NEED_TRUTH = {"5.4", "5.6", "5.7", "5.8", "5.9", "6.3", "6.5", "6.7"}
NEED_FLOW = {"5.9", "6.6"}
NEED_OTHERS = {"5.1", "5.2", "5.3", "5.5"}  # what only runs of other materials show


class Proportional:
    """A density in proportion to the mean of f cos(theta_o): log_prob is right up to a constant."""

    def log_prob(self, wi, wo):
        return np.log(TRUTH.eval(wi, wo).mean(1) * wo[:, 2] / 2.5)


@pytest.fixture(scope="module")
def samples():
    wi, wo = walk(TRUTH, {"proposal": "pss_simple"}, 400, 1)
    return Samples.of(wi, wo, TRUTH.eval(wi, wo))


@pytest.fixture(scope="module")
def ours(samples):
    return reconstruct(samples, "ggx")


def subject(samples, ours, **more):
    return Subject("chm_orange", "pss_simple", ("R", "G", "B"), samples, ours, size=16, spp=1, **more)


def test_all_numbers_have_a_function():
    assert list(FIGURES) == NUMBERS


def made(s, folder):
    lines = make_all(s, folder)
    assert len(lines) == len(NUMBERS) + 1
    page = (folder / "index.html").read_text()
    assert all(f"<h2>{n} " in page for n in NUMBERS)
    there = {n for n in NUMBERS if (folder / f"figure_{n.replace('.', '_')}.png").exists()}
    assert page.count("<img") == len(there) and page.count("Not made: ") == len(NUMBERS) - len(there)
    return there


def test_with_truth_and_flow_all_of_its_material(samples, ours, tmp_path):
    s = subject(samples, ours, truth=TRUTH, density=Proportional(), flow=ours)
    assert made(s, tmp_path) == set(NUMBERS) - NEED_OTHERS


def test_without_truth_and_flow_those_that_need_neither(samples, ours, tmp_path):
    assert made(subject(samples, ours), tmp_path) == set(NUMBERS) - NEED_OTHERS - NEED_TRUTH - NEED_FLOW
    with pytest.raises(Missing, match=r"^figure 6\.3: needs the truth.*--truth$"):
        make_figure("6.3", subject(samples, ours), tmp_path)
    with pytest.raises(Missing, match=r"^figure 6\.6: needs a flow"):
        make_figure("6.6", subject(samples, ours), tmp_path)


def test_a_material_that_the_thesis_did_not_have_goes_by_the_first_number(samples, ours, tmp_path):
    other = Subject("felt", "auto", ("R", "G", "B"), samples, ours, TRUTH, size=16, spp=1)
    assert make_figure("5.1", other, tmp_path).exists()
    with pytest.raises(Missing, match="chm_orange"):
        make_figure("5.4", other, tmp_path)


def test_most_sampled_columns_are_the_fewest_that_hold_the_energy():
    density = np.zeros((3, 10))
    density[:, 4:6] = 1.0
    density[:, 8] = 0.2
    assert grids.most_sampled(density) == slice(4, 6)


def test_constant_is_that_of_the_thesis(samples, ours):
    """f cos = c q: where that holds exactly, (4.15) finds c."""
    assert abs(grids.constant(subject(samples, ours, density=Proportional())) - 2.5) < 1e-9


def test_a_density_of_half_vectors_is_one_over_the_square():
    density = grids.energy_density(TRUTH, 45.0)
    assert density.shape == (grids.ROWS, grids.COLUMNS) and abs(density.mean() - 1) < 1e-12
    # columns of a wide lobe: more than half of the energy lies in the middle of the square
    assert density[:, 10:90].sum() > 0.5 * density.sum()


def test_halves_are_put_together():
    a, b = np.zeros((grids.ROWS, 4)), np.ones((grids.ROWS, 4))
    both = grids.over(a, b)
    assert both.shape == (grids.ROWS + 1, 4) and both[: grids.ROWS // 2 + 1].max() == 0 and both[-1].min() == 1


def test_nodes_drawn_by_the_right_lobe_lose_little_those_by_a_wrong_one_much():
    def error(alpha):
        brdf, total, wrong = WarpedSlices(TRUTH, alpha), 0.0, 0.0
        for wi, wo, weight, _ in directions(1000):
            w = (weight * wo[:, 2])[:, None]
            truth = TRUTH.eval(wi, wo)
            total, wrong = total + (truth * w).sum(), wrong + (np.abs(brdf.eval(wi, wo) - truth) * w).sum()
        return wrong / total

    assert error(0.2) < 0.1 and error(0.01) > 3 * error(0.2)


def test_no_such_figure(tmp_path):
    from gonio.run.products import make_figures

    with pytest.raises(ConfigError, match=r"--figures 7\.1: not `thesis` or one of 5\.1"):
        make_figures(tmp_path, "7.1")
