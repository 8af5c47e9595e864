"""The plan that looks for the unknown: densities, draws, steps and weights are what they are said to be."""

import numpy as np
import pytest
from oracle import Known, exact_bins, glossy, p_value
from scipy.stats import chi2

from gonio.config import Material
from gonio.config.material import SamplerConfig
from gonio.mcmc import NoSupport, Sampler, make_sampler
from gonio.mcmc.plans import epoch as epochs
from gonio.mcmc.plans.epoch import Epoch
from gonio.mcmc.plans.unknown import PILOT, UnknownPlan, first_directions
from gonio.mcmc.proposals import DRAWN, FILL, INDEPENDENCE
from gonio.mcmc.proposals.pivotal import pivotal
from gonio.mcmc.proposals.pool import LOWEST, Pool
from gonio.mcmc.proposals.spread import fill
from gonio.mcmc.target import Unknown

BRDF = glossy(0.3)


def surrogate(alpha):
    return lambda wi, wo, f, sigma=None: Known(glossy(alpha))


def everything(wi, wo):
    return np.ones(len(wi), bool)


# ---- candidates


@pytest.mark.parametrize("t", [0.002, 0.05, 0.5])
def test_the_pools_density_is_the_volume_of_its_map(t):
    """Against central differences of the map from the cube to both directions."""
    pool, rng = Pool(t), np.random.default_rng(0)
    u = rng.uniform(0.05, 0.6, (400, 4))
    step = 1e-6

    def pair(x):
        theta_h = pool.t * np.sinh(x[:, 0] * pool.length)
        from gonio.geometry import from_half_diff

        angles = (theta_h, 2 * np.pi * x[:, 3], np.pi / 2 * x[:, 1], 2 * np.pi * x[:, 2])
        return np.concatenate(from_half_diff(*angles), 1)

    columns = []
    for k in range(4):
        d = np.zeros(4)
        d[k] = step
        columns.append((pair(u + d) - pair(u - d)) / (2 * step))
    j = np.stack(columns, -1)
    volume = 0.5 * np.linalg.slogdet(np.einsum("nik,nil->nkl", j, j))[1]
    p = pair(u)
    keep = (p[:, 2] > LOWEST) & (p[:, 5] > LOWEST)
    assert np.abs(volume + pool.log_prob(p[:, :3], p[:, 3:]))[keep].max() < 1e-4


def test_the_pool_integrates():
    """The mean of 1 / density is the measure of all pairs above the lowest elevation."""
    pool, count = Pool(0.05), 2**16
    wi, wo = pool.candidates(count, np.random.default_rng(1))
    total = np.exp(-pool.log_prob(wi, wo)).sum() / count
    assert abs(total / (2 * np.pi * (1 - LOWEST)) ** 2 - 1) < 0.01


def test_first_directions_have_their_density():
    wi, _, log_q = first_directions(True)
    total = np.exp(-log_q).sum() / 1024
    assert abs(total / (2 * np.pi) ** 2 - 1) < 0.05
    assert len(wi) > 8 * PILOT


# ---- draws that keep apart


def test_units_are_drawn_with_the_probabilities_they_were_given():
    """Chi-square over many draws, with a negative control; as many each time as the probabilities sum to."""
    rng = np.random.default_rng(2)
    x, p = rng.random((60, 3)), rng.uniform(0.02, 0.9, 60)
    p *= 20 / p.sum()
    p = np.minimum(p, 1.0)
    runs, seen = 3000, np.zeros(60)
    sizes = set()
    for _ in range(runs):
        drawn = pivotal(x, p, rng)
        sizes.add(len(drawn))
        seen[drawn] += 1
    inside = (p > 1e-9) & (p < 1 - 1e-9)

    def statistic(q):
        return np.sum((seen - runs * q)[inside] ** 2 / (runs * q * (1 - q))[inside])

    assert chi2.sf(statistic(p), inside.sum()) > 1e-4
    assert chi2.sf(statistic(np.clip(p * 1.1, 0, 0.999)), inside.sum()) < 1e-6
    assert sizes <= {int(np.floor(p.sum())), int(np.ceil(p.sum()))}


def test_neighbours_are_hardly_ever_drawn_together():
    rng = np.random.default_rng(3)
    x = rng.random((2000, 2))
    p = np.full(2000, 0.05)

    def nearest(i):
        d = np.linalg.norm(x[i][:, None] - x[i][None], axis=2) + 9 * np.eye(len(i))
        return d.min(1)

    apart = np.concatenate([nearest(pivotal(x, p, rng)) for _ in range(20)])
    alone = np.concatenate([nearest(np.flatnonzero(rng.random(2000) < p)) for _ in range(20)])
    assert np.quantile(apart, 0.1) > 2 * np.quantile(alone, 0.1)


def test_units_that_are_sure_or_impossible():
    rng = np.random.default_rng(4)
    x = rng.random((5, 2))
    assert list(pivotal(x, np.array([0, 1, 0, 1, 0.0]), rng)) == [1, 3]
    assert len(pivotal(np.zeros((50, 2)), np.full(50, 0.5), rng)) == 25  # all in one place
    assert len(pivotal(x[:0], np.empty(0), rng)) == 0


def test_holes_are_filled_the_largest_first():
    x = np.array([[0.0], [1.0], [2.0], [3.0], [10.0]])
    assert list(fill(x, np.ones(5), 3, np.array([[0.0]]))) == [4, 3, 1]
    assert list(fill(x, np.array([1, 100, 1, 1, 1.0]), 1, np.array([[0.0]]))) == [1]  # wanted more densely there
    assert len(fill(x, np.ones(5), 9, np.empty((0, 1)))) == 5


# ---- steps


def run(plan, chains, blocks, seed=1, brdf=BRDF):
    """Blocks no larger than the chains need: as many steps as blocks."""
    plan._size = lambda asked: max(chains, 60)
    sampler = Sampler(plan, Unknown("mean", 0.7, 0.0, 1), chains=chains, channels=1, seed=seed)
    while sampler.step < blocks:
        batch = sampler.ask()
        sampler.tell(batch.ids, brdf.eval(batch.wi, batch.wo))
    return sampler


def bins_of(sampler):
    return exact_bins(BRDF, sampler.target, counts=(5, 3, 2), fine=(120, 48, 24))


@pytest.mark.parametrize("alpha", [0.3, 0.6, 0.15], ids=["right", "too rough", "too sharp"])
def test_chains_reach_the_epochs_target_whatever_the_reconstruction_is_worth(alpha):
    plan = UnknownPlan(surrogate(alpha), anisotropic=False, adapt=False)
    sampler = run(plan, 500, 12)
    assert p_value(sampler, bins_of(sampler)) > 1e-3


def test_chains_of_a_picture_reach_its_target():
    """w multiplies the target; a chain that forgets it does not get there (negative control)."""

    def asked(wi, wo):  # light from one side of the sky, seen at grazing angles
        return np.log(0.05 + np.where((wo[:, 2] < 0.5) & (wi[:, 2] > 0.5), 4.0, 0.0))

    sampler = run(UnknownPlan(surrogate(0.6), anisotropic=False, adapt=False, asked=asked), 500, 12)
    assert p_value(sampler, bins_of(sampler)) > 1e-3
    plain = run(UnknownPlan(surrogate(0.6), anisotropic=False, adapt=False), 500, 12)
    assert p_value(plain, bins_of(sampler)) < 1e-6


def test_negative_control_draws_whose_thinning_is_forgotten_are_found(monkeypatch):
    """The density of the candidates in place of that of the draws."""
    monkeypatch.setattr(Epoch, "log_prob", lambda self, wi, wo: self.pool.log_prob(wi, wo))
    from gonio.mcmc.plans import unknown

    whole = unknown.draw

    def forgetful(epoch, *args):
        b = whole(epoch, *args)
        return unknown.Block(b.wi, b.wo, epoch.pool.log_prob(b.wi, b.wo), b.kind, b.alive, b.log_rest)

    monkeypatch.setattr(unknown, "draw", forgetful)
    sampler = run(UnknownPlan(surrogate(0.6), anisotropic=False, adapt=False), 500, 12)
    assert p_value(sampler, bins_of(sampler)) < 1e-6


def test_a_reading_that_is_not_what_was_expected_is_what_the_chain_goes_by():
    """All of f in the target is measured: chains of two materials with one reconstruction differ."""
    plan = UnknownPlan(surrogate(0.3), anisotropic=False, adapt=False)
    sampler = run(plan, 500, 12, brdf=glossy(0.1))
    assert p_value(sampler, bins_of(sampler)) < 1e-6


# ---- weights


def totals(alpha, seeds, weigh=np.exp):
    """Estimates of the integral of f cos over wi and wo by what was drawn, block after block."""
    out = []
    for seed in seeds:
        sampler = run(UnknownPlan(surrogate(alpha), anisotropic=False), 1, 3, seed)
        s = sampler.take_steps()
        drawn = np.isin(s.kind, (INDEPENDENCE, DRAWN)) & (s.id >= 0)
        block = np.where(s.step >= 0, s.step + 1, s.chain)
        value = BRDF.eval(s.wi, s.wo)[:, 0] * s.wo[:, 2] * weigh(-s.log_q)
        out.append([value[drawn & (block == b)].mean() for b in range(1, 4)])
    return np.array(out)


def test_integrals_of_what_was_drawn_are_unbiased():
    wi, wo = Pool(0.1).candidates(2**18, np.random.default_rng(6))
    exact = np.sum(BRDF.eval(wi, wo)[:, 0] * wo[:, 2] * np.exp(-Pool(0.1).log_prob(wi, wo))) / 2**18
    found = totals(0.6, range(12)).mean(1)
    error = found.std(ddof=1) / np.sqrt(len(found))
    assert abs(found.mean() - exact) < 4 * error + 2e-3 * exact
    wrong = totals(0.6, range(4), lambda x: np.exp(0.9 * x)).mean(1)  # negative control: another density
    assert abs(wrong.mean() / exact - 1) > 0.2


# ---- blocks


def material(**more):
    return Material.model_validate({"name": "x", "channels": 1, "seed": 3, "sampler": more})


def blocks_of(sampler, total):
    sizes = []
    while sum(sizes) < total:
        batch = sampler.ask()
        sizes.append(len(batch.ids))
        sampler.tell(batch.ids, BRDF.eval(batch.wi, batch.wo))
    return sizes


def test_blocks_double_and_the_last_before_the_budget_is_one_tour():
    sizes = blocks_of(make_sampler(material(), None, surrogate(0.3), (1000,)), 1000)
    assert sizes == [24, 24, 48, 96, 192, 384, 232]


def test_a_budget_that_was_raised_leaves_what_came_before_as_it_was():
    a, b = (make_sampler(material(), None, surrogate(0.3), cuts) for cuts in ((300,), (300, 900)))
    for _ in range(5):
        x, y = a.ask(), b.ask()
        assert np.array_equal(x.wi, y.wi)
        for s, batch in ((a, x), (b, y)):
            s.tell(batch.ids, BRDF.eval(batch.wi, batch.wo))
    assert a.next_id == 300


def test_half_of_a_block_has_weights_and_half_fills_holes():
    sampler = make_sampler(material(), None, surrogate(0.3), (400,))
    blocks_of(sampler, 400)
    s = sampler.take_steps()
    drawn, filled = np.isin(s.kind, (INDEPENDENCE, DRAWN)) & (s.id >= 0), s.kind == FILL
    assert abs(drawn.sum() - filled.sum()) < 20
    assert np.isfinite(s.log_q[drawn]).all() and np.isnan(s.log_q[filled]).all()
    assert len(np.unique(s.id[s.id >= 0])) == 400
    assert (s.step[filled] < 0).all() and set(s.chain[filled]) == {1, 2, 3, 4}  # the blocks they belong to


def test_nothing_is_asked_twice_and_holes_are_not_where_samples_are():
    sampler = make_sampler(material(), None, surrogate(0.3), (800,))
    asked = []
    while sum(len(w) for w in asked) < 800:
        batch = sampler.ask()
        asked.append(np.concatenate([batch.wi, batch.wo], 1))
        sampler.tell(batch.ids, BRDF.eval(batch.wi, batch.wo))
    assert len(np.unique(np.concatenate(asked).round(9), axis=0)) == 800


@pytest.mark.parametrize("fit", [None, lambda wi, wo, f, sigma=None: None], ids=["none", "never one"])
def test_without_a_reconstruction_it_looks_evenly(fit):
    sampler = make_sampler(material(), None, fit, (400,))
    assert blocks_of(sampler, 400) == [24, 24, 48, 96, 208]
    s = sampler.take_steps()
    theta_i = np.degrees(np.arctan2(np.hypot(s.wi[:, 0], s.wi[:, 1]), s.wi[:, 2]))[s.id >= 0]
    assert (np.histogram(theta_i, 6, (0, 90))[0] > 15).all()


def test_a_rig_that_reaches_little_is_looked_at_there_only():
    def reachable(wi, wo):
        return (wi[:, 2] > 0.5) & (wo[:, 2] > 0.5)

    sampler = make_sampler(material(), reachable, surrogate(0.3), (400,))
    blocks_of(sampler, 400)
    s = sampler.take_steps()
    assert reachable(s.wi, s.wo)[s.id >= 0].all()
    nothing = make_sampler(material(), lambda wi, wo: np.zeros(len(wi), bool), surrogate(0.3))
    with pytest.raises(NoSupport, match="stay-out"):
        nothing.ask()


def test_a_view_in_parts_is_the_same(monkeypatch):
    rng = np.random.default_rng(8)
    e = Epoch(Known(BRDF), Unknown("mean", 0.7, 0.0, 1), Pool(0.1).candidates(64, rng), everything, rng)
    wi, wo = e.candidates(4096, rng)
    whole = e.view(wi, wo)
    monkeypatch.setattr(epochs, "AT_ONCE", 1)
    parts = e.view(wi, wo)
    assert np.allclose(whole.log_p, parts.log_p, rtol=1e-12) and whole.x.shape == parts.x.shape


def test_an_epoch_that_knows_nothing_yet():
    rng = np.random.default_rng(9)
    e = Epoch(Known(BRDF), Unknown("mean", 0.7, 0.0, 1), (np.empty((0, 3)), np.empty((0, 3))), everything, rng)
    assert np.isfinite(e.view(*e.candidates(256, rng)).log_p).all()


def test_every_channel_counts_by_its_own_albedo():
    """A channel a thousandth as bright as another is looked for as much."""
    from gonio.brdf.models.microfacet import Ggx
    from gonio.brdf.models.mixture import Mixture

    both = Mixture([Ggx(0.05, None, [0.9, 0.0]), Ggx(0.6, None, [0.0, 1e-2])])
    rng = np.random.default_rng(5)
    wi, wo = Pool(0.1).candidates(256, rng)
    e = Epoch(Known(both), Unknown("mean", 1.0, 0.0, 2), (wi, wo), everything, rng)
    wi, wo = e.candidates(2**14, rng)
    share = both.eval(wi, wo) * e.inverse_albedo(wi) * (wo[:, 2] * np.exp(-e.pool.log_prob(wi, wo)))[:, None]
    total = share.sum(0)
    assert abs(total[1] / total[0] - 1) < 0.2
    assert epochs.BANDS == len(e._inverse_albedo)


@pytest.mark.parametrize(
    ("section", "kind", "power", "channels"),
    [
        ({}, "unknown", 0.7, "mean"),
        ({"target": {"kind": "energy"}}, "energy", 1.0, "max"),
        ({"proposal": "pss_vndf"}, "energy", 1.0, "max"),
        ({"target": {"power": 0.5, "channels": 0}}, "unknown", 0.5, 0),
    ],
)
def test_what_a_config_leaves_open_is_settled(section, kind, power, channels):
    t = SamplerConfig.model_validate(section).target
    assert (t.kind, t.power, t.channels) == (kind, power, channels)


def test_the_unknown_is_a_target_of_auto_alone():
    with pytest.raises(ValueError, match="with pss_simple use energy"):
        SamplerConfig.model_validate({"proposal": "pss_simple", "target": {"kind": "unknown"}})
