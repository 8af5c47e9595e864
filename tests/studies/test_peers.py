"""Every way of looking, on an ideal rig: as many measurements as it was given, and a BRDF of them."""

import numpy as np
import pytest

from gonio.bench.accuracy.peer_tables import reached
from gonio.bench.harness.plots import pareto
from gonio.bench.peers import PEERS, nielsen, peer
from gonio.bench.peers.greedy_gp import START, kernel, most_uncertain
from gonio.bench.peers.merl_grid import GridBrdf, grid, largest
from gonio.bench.peers.rgl_grid import Adaptive
from gonio.bench.peers.session import Session
from gonio.brdf import Ggx, Lambert
from gonio.brdf.models.mixture import Mixture
from gonio.config import load_config
from gonio.config.find import find_config
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.evaluate import evaluate
from gonio.geometry import from_angles, from_half_diff
from gonio.reconstruct import reconstruct

TRUTH = Mixture([Lambert([0.2] * 3), Ggx(0.3, None, [0.5] * 3)])


def session(truth=TRUTH, material="nothing_like_it"):
    rig = load_config(find_config("ideal", "rigs"), RigConfig)
    return Session(material, truth, rig, 1, PlanConfig())


needs_networks = pytest.mark.skipif(not nielsen.archive().exists(), reason="the archive of networks is not here")


@pytest.mark.parametrize(
    "name, n, error",
    [("ours", 80, 0.05), ("chain of before", 120, 0.08), ("sobol list", 80, 0.06), ("ggx importance", 80, 0.06),
     ("stratified", 200, 0.2), ("merl grid", 200, 0.2), ("rgl grid", 200, 0.2), ("greedy gp", 80, 0.15),
     ("thesis", 200, 0.2), pytest.param("nielsen pca", 20, 0.25, marks=needs_networks)],
)  # fmt: skip
def test_looks(name, n, error):
    s = session()
    peer(name).look(s, n, np.random.default_rng(1))
    assert 0.6 * n <= s.measured <= n  # a grid is the largest that fits
    assert len(s.samples) == s.measured
    assert evaluate(reconstruct(s.samples), TRUTH, n=1000)["energy_mean"] < error


def test_all_are_tried_here():
    assert set(PEERS) == {m.values[0] if hasattr(m, "values") else m[0] for m in test_looks.pytestmark[0].args[1]}


@pytest.mark.parametrize(
    "name, n, error", [("rgl grid", 2000, 0.05), ("merl grid", 4000, 0.12), ("ggx importance", 100, 0.5)]
)
def test_their_own_reconstruction(name, n, error):
    s = session()
    peer(name).look(s, n, np.random.default_rng(1))
    assert evaluate(peer(name).own(s), TRUTH, n=1000)["energy_mean"] < error


@needs_networks
def test_nielsen_knows_materials():
    """20 directions tell more of a network than 3 do, though its kin is left out."""
    from gonio.bench.drive import truth_of

    name = next(n for n in nielsen.names_of(str(nielsen.archive())) if "red-fabric2" in n)
    truth = truth_of(f"{nielsen.archive()}:{name}")
    errors = []
    for n in (3, 20):
        s = session(truth, name)
        nielsen.look(s, n, np.random.default_rng(1))
        errors.append(evaluate(nielsen.own(s), truth, n=1000)["energy_mean"])
    assert errors[1] < 0.2 and errors[1] < 0.5 * errors[0]
    everyone = 3 * len(nielsen.names_of(str(nielsen.archive())))
    assert nielsen.Known.of(nielsen.kin(name)).count < everyone == nielsen.Known.of("nobody").count


def test_telling_rows_are_those_of_the_largest_determinant():
    rows = np.array([[1.0, 0], [0.9, 0], [0, 0.5], [0.1, 0.1]])
    assert nielsen.telling(rows, 2, 0.1).tolist() == [0, 2]
    determinant = lambda k: np.linalg.det(0.1 * np.eye(2) + rows[list(k)].T @ rows[list(k)])
    assert all(determinant((0, 2)) >= determinant((i, j)) for i in range(4) for j in range(i))


def test_most_uncertain_by_the_full_posterior():
    rng = np.random.default_rng(3)
    pool, known = rng.random((40, 3)), rng.random((6, 3))
    chosen = most_uncertain(pool, known, START, 5)
    have = known
    for k in chosen:
        inside = kernel(have, have, START) + np.exp(2 * START[4]) * np.eye(len(have))
        across = kernel(have, pool, START)
        variance = np.exp(2 * START[3]) - np.einsum("ij,ij->j", across, np.linalg.solve(inside, across))
        assert variance[k] == pytest.approx(variance.max(), rel=1e-9)
        have = np.concatenate([have, pool[k : k + 1]])


def test_merl_grid_reads_its_nodes_back():
    s = session()
    peer("merl grid").look(s, 900, np.random.default_rng(1))
    own = GridBrdf(s, largest(s, s.measured)[1])
    nodes = grid(largest(s, s.measured)[1])
    wi, wo = from_half_diff(nodes[:, 0], 0 * nodes[:, 0], nodes[:, 1], nodes[:, 2])
    keep = (wi[:, 2] > 1e-3) & (wo[:, 2] > 1e-3) & s.reachable(wi, wo)
    assert np.allclose(own.eval(wi[keep], wo[keep]), TRUTH.eval(wi[keep], wo[keep]), rtol=1e-6)


def test_rgl_finds_the_normals_of_a_ggx_surface():
    """The power iteration on retro-reflection gives D back: its half width is the lobe's."""
    lobe = Ggx(0.2, None, [1.0])
    theta = np.pi / 2 * ((np.arange(90) + 0.5) / 90) ** 2
    w = from_angles(theta, 0 * theta)
    plan = Adaptive(theta, lobe.eval(w, w)[:, 0])
    x = np.linspace(0, 1, plan.ndf.shape[1])
    at = np.tan(np.pi / 2 * x[x < 0.6] ** 2)
    right = (1 + at**2) ** 2 / (np.pi * 0.04 * (1 + at**2 / 0.04) ** 2)
    assert np.allclose(plan.ndf[0][x < 0.6] / right, 1, atol=0.12)


def test_what_an_error_costs():
    rows = [{"n": n, "measured": n, "energy": 10 / n, "material": "a"} for n in (100, 300, 1000)]
    assert reached(rows, 0.05, "measured") == pytest.approx(200)
    assert reached(rows, 0.005, "measured") == pytest.approx(2000)  # a little beyond
    assert reached(rows, 0.0005, "measured") is None
    assert reached(rows[:1], 0.05, "measured") is None


def test_pareto_front():
    points = np.array([[1, 5], [2, 6], [3, 3], [4, 3.0], [5, 1]])
    assert pareto(points).tolist() == [[1, 5], [3, 3], [5, 1]]
