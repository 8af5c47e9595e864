"""Proposal `flow`: right, recoverable, and never the worse for a flow that is good for nothing."""

import subprocess
import sys

import numpy as np
import pytest

from gonio.bench.drive import driven_by
from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.config import Material
from gonio.flow import shipped
from gonio.flow.cubes import make_cube
from gonio.flow.density import FlowDensity
from gonio.flow.flow import Flow, FlowError, Shape
from gonio.mcmc import make_sampler
from gonio.mcmc.proposals.flow_mixture import FlowMixture, best_share
from gonio.mcmc.proposals.independence import single_lobe

GLOSSY = Mixture([Lambert(0.25), Ggx(0.2, None, 0.6)])
CODE = {"proposal": "flow", "flow": {"train": False}}


def sampler(section, seed=1, chains=2):
    return make_sampler(
        Material.model_validate({"name": "x", "channels": 1, "seed": seed, "sampler": {**section, "chains": chains}})
    )


def advance(s, n, brdf=GLOSSY):
    seen = []
    while sum(len(b[0]) for b in seen) < n:
        b = s.ask()
        seen.append((b.wi, b.wo))
        s.tell(b.ids, brdf.eval(b.wi, b.wo))
    return seen


def test_mixture_is_one_density():
    cube = make_cube("half", 0.1)
    flow = FlowDensity(shipped.zoo()[4][1], cube)
    q = FlowMixture(single_lobe(0.02, 0.02), flow, 0.6, 0.1)
    rng = np.random.default_rng(0)
    wi, wo = q.sample(rng.random((5, 60_000)))
    up = wo[:, 2] > 0
    w = wi[up, 2] * wo[up, 2] / np.exp(q.log_prob(wi[up], wo[up]))
    assert w.sum() / len(wi) == pytest.approx(np.pi**2, abs=6 * w.std() / np.sqrt(len(wi)))
    wrong = np.exp(np.log(0.6) + flow.log_prob(wi[up], wo[up]))  # negative control: the other parts left out
    assert (wi[up, 2] * wo[up, 2] / wrong).sum() / len(wi) > 1.3 * np.pi**2


def test_albedo_by_the_chain_is_that_by_quadrature():
    d, s = driven_by(GLOSSY, CODE, 1500, chains=4, seed=3)
    w = d.chains(d.f.mean(1) * d.wo[:, 2], 0.1) * np.exp(-d.log_p(0.1))
    steep = d.chains(d.wi[:, 2], 0.1) > 0.5
    share = (w * steep).mean() / w.mean()
    rng = np.random.default_rng(0)
    cube = make_cube("half", 0.1)
    x = rng.random((200_000, 3))
    wi, wo = cube.to_directions(x)
    g = GLOSSY.eval(wi, wo).mean(1) * wo[:, 2] * np.exp(cube.log_jacobian(x, wi, wo))
    assert share == pytest.approx((g * (wi[:, 2] > 0.5)).mean() / g.mean(), abs=0.06)
    assert s.plan.audit[-1]["share"] > 0.5


def test_restored_goes_on_bit_for_bit():
    a = sampler(CODE)
    advance(a, 300)
    b = sampler(CODE)
    b.restore(a.state())
    for (wi, wo), (vi, vo) in zip(advance(a, 300), advance(b, 300)):
        assert np.array_equal(wi, vi) and np.array_equal(wo, vo)


def test_a_useless_flow_gets_no_share():
    rng = np.random.default_rng(1)
    lobes, w = rng.normal(0, 0.2, 500), np.ones(500)
    assert best_share(lobes, lobes - 3, w) < 0.01
    assert best_share(lobes, lobes + 1, w) == 0.95
    assert best_share(lobes, lobes, np.zeros(500)) == 0


def test_spoilt_weights_fall_back_to_auto_and_say_so(monkeypatch):
    def spoilt():
        raise FlowError("code.npz: not a flow's weights; make them with `gonio bench pretrain`")

    monkeypatch.setattr(shipped, "conditional", spoilt)
    s, auto = sampler(CODE), sampler({"proposal": "auto", "target": {"kind": "energy"}})
    for (wi, _), (vi, _) in zip(advance(s, 400), advance(auto, 400)):
        assert np.array_equal(wi, vi)  # the very chain `auto` would have made
    assert s.plan.audit and all(e["chosen"] == "none" and "code.npz" in e["why"] for e in s.plan.audit)
    assert s.plan.density is None


def test_a_flow_of_ones_own_is_used(tmp_path):
    own = tmp_path / "own.npz"
    with np.load(shipped.FOLDER / "code.npz") as d:
        arrays = {k: d[k] for k in d.files}
    np.savez(own, **arrays)
    runs = {}
    for name, weights in (("ships", None), ("copy", str(own)), ("other", str(tmp_path / "other.npz"))):
        if name == "other":  # negative control: with other weights it is another chain
            np.savez(weights, **{k: v * 0.9 if k.startswith("weight.") else v for k, v in arrays.items()})
        runs[name] = np.concatenate(
            [wi for wi, _ in advance(sampler({**CODE, "flow": {**CODE["flow"], "weights": weights}}), 400)]
        )
    assert np.array_equal(runs["ships"], runs["copy"])
    assert not np.array_equal(runs["ships"], runs["other"])
    with pytest.raises(FlowError, match="no codes of 0 numbers"):
        sampler({**CODE, "flow": {"weights": str(shipped.FOLDER / "ggx_0.1.npz")}})


@pytest.mark.parametrize("proposal", ["auto", "flow"])
def test_without_torch(proposal):
    """Nothing but training needs torch; a flow whose code alone is fitted does without."""
    code = (
        "import sys; sys.modules['torch'] = None\n"
        "sys.path.insert(0, 'tests/mcmc')\n"
        "from test_flow_plan import sampler, advance\n"
        f"s = sampler({{'proposal': '{proposal}'}}); advance(s, 700)\n"
        "print(s.next_id)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-500:]
    assert int(done.stdout) > 300


def two_peaks(wi, wo):
    """Mass in two places far apart in theta_h, equal shares; (N, 1)."""
    cube = make_cube("half", 0.1)
    x = cube.from_directions(wi, wo)
    log_j = cube.log_jacobian(x, wi, wo)
    p = np.exp(-0.5 * ((x[:, 0] - 0.25) / 0.04) ** 2) + np.exp(-0.5 * ((x[:, 0] - 0.75) / 0.04) ** 2)
    return np.exp(np.log(p + 1e-12) - log_j)[:, None] / np.maximum(wo[:, 2:3], 1e-9)


def test_a_mode_that_the_start_leaves_out_is_found(monkeypatch):
    """METHOD 8: two equal modes, pretrained on one; all proposals weighted f / q find the other."""
    torch = pytest.importorskip("torch", reason="the flow is trained")
    assert torch
    from gonio.flow.train import train

    shape = Shape(leading=(2,), hidden=16, bins=16, couplings=2)
    rng = np.random.default_rng(0)
    x = rng.random((3000, 3))
    x[:, 0] = np.clip(rng.normal(0.25, 0.04, 3000), 0, 1)
    one = train(Flow.fresh(shape, rng), x, steps=200, batch=128, rate=5e-3, rng=rng).flow
    monkeypatch.setattr(shipped, "zoo", lambda: (("one", one),))

    class Peaks:
        channels = 1

        def eval(self, wi, wo):
            return two_peaks(wi, wo)

    def second_mode(section):
        target = {"target": {"channels": 0, "floor": 0.0}}
        d, s = driven_by(Peaks(), {"proposal": "flow", **section, **target}, 1500, chains=2, seed=2)
        state = d.steps.state[d.steps.state >= 0][-1500:]
        x = make_cube("half", 0.1).from_directions(d.wi[state], d.wo[state])
        return (x[:, 0] > 0.5).mean(), s.plan

    share, plan = second_mode({"flow": {"start": "zoo"}})
    assert 0.3 < share < 0.7
    assert "trained" in [e["chosen"] for e in plan.audit]
    lost, _ = second_mode({"adapt": "thesis", "global_share": 0.02})  # negative control: accepted states alone
    assert lost < 0.2


def test_anisotropic_from_nothing():
    pytest.importorskip("torch", reason="a fresh flow is trained")
    s = make_sampler(
        Material.model_validate(
            {"name": "x", "channels": 1, "symmetry": "anisotropic", "sampler": {"proposal": "flow", "chains": 2}}
        )
    )
    advance(s, 500, Mixture([Lambert(0.1), Ggx(0.1, 0.3, 0.6)]))
    assert s.plan.density.cube.dimensions == 4
    assert "trained" in s.plan.audit[-1]


@pytest.mark.parametrize(
    "sampler, symmetry, said",
    [
        ({"proposal": "auto", "adapt": "thesis"}, "isotropic", "sampler.proposal: flow"),
        ({"proposal": "flow", "adapt": "thesis"}, "anisotropic", "isotropic lobes"),
    ],
)
def test_what_cannot_be_is_refused(sampler, symmetry, said):
    with pytest.raises(ValueError, match=said):
        Material.model_validate({"name": "x", "symmetry": symmetry, "sampler": sampler})
