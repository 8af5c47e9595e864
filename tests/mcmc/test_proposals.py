"""Every proposal reaches the target, measured by the oracle; a wrong Jacobian does not."""

import numpy as np
import pytest
from oracle import exact_bins, glossy, mean_error, p_value, run

from gonio.config.material import SamplerConfig
from gonio.mcmc.plans import Fixed, auto, make_plan, plain_proposal
from gonio.mcmc.plans.auto import Auto
from gonio.mcmc.plans.delayed import Delayed
from gonio.mcmc.proposals.pss_ndf import PssNdf
from gonio.mcmc.proposals.pss_simple import PssSimple
from gonio.mcmc.proposals.screened import KEPT, Screened, ratios
from gonio.mcmc.target import Target

PLAIN = ("pss_simple", "pss_vndf", "vmf_io", "vmf_hd", "independence")
LEVEL = 1 - (1 - 0.001) ** (1 / 20)  # Sidak: 20 tests share one chance in a thousand of a false alarm
BRDF = glossy()
CONFIG = {"sigma": 0.15, "global_share": 0.3, "kappa": 20.0, "alpha": 0.4}


def thinned_always(mixtures, log_surrogate, *seen):
    return mixtures[0], Screened(mixtures[0], log_surrogate, 0.15, ratios(mixtures[0], log_surrogate))


def thesis_target():
    return Target(0, 1.0, 0.0, 1)


@pytest.fixture(scope="module")
def bins():
    return exact_bins(BRDF, thesis_target())


def plan_of(name, anisotropic=False, **more):
    return make_plan(SamplerConfig(proposal=name, target={"kind": "energy"}, **(CONFIG | more)), anisotropic)


@pytest.mark.parametrize("name", PLAIN)
def test_reaches_the_target(name, bins):
    sampler = run(plan_of(name, block=8), BRDF, chains=3000, steps=64)
    assert p_value(sampler, bins) > LEVEL
    assert mean_error(sampler, bins) < 4.5


@pytest.mark.parametrize("boundary", ["wrap", "reflect"])
def test_both_boundaries_are_symmetric(boundary, bins):
    sampler = run(plan_of("pss_simple", boundary=boundary), BRDF, chains=3000, steps=60, seed=4)
    assert p_value(sampler, bins) > LEVEL


@pytest.mark.parametrize("adapt", [True, False])
def test_auto_reaches_the_target_adapting_or_not(adapt, bins):
    sampler = run(Auto(block=8, anisotropic=False, adapt=adapt), BRDF, chains=3000, steps=40)
    assert p_value(sampler, bins) > LEVEL
    assert mean_error(sampler, bins) < 4.5


@pytest.mark.parametrize("surrogate", [glossy(0.3), glossy(0.6), glossy(0.05)], ids=["right", "too rough", "too sharp"])
def test_draws_thinned_by_any_surrogate_reach_the_target(surrogate, bins, monkeypatch):
    """Also by one that the held-out measurements would have refused."""
    monkeypatch.setattr(auto, "choose", thinned_always)
    plan = Auto(block=8, anisotropic=False, fit_surrogate=lambda wi, wo, f: surrogate)
    sampler = run(plan, BRDF, chains=3000, steps=40, seed=11)
    assert plan.independence.screened is not None
    assert p_value(sampler, bins) > LEVEL
    assert mean_error(sampler, bins) < 4.5


def test_a_surrogate_is_used_as_far_as_unseen_measurements_agree_with_it():
    shares = []
    for surrogate in (BRDF, glossy(0.02)):
        plan = Auto(block=8, anisotropic=False, fit_surrogate=lambda wi, wo, f, s=surrogate: s)
        run(plan, BRDF, chains=300, steps=40, seed=12)
        screened = plan.independence.screened
        shares.append(1.0 if screened is None else screened.rho / KEPT)
    assert abs(shares[0] - 0.15) < 1e-9 and shares[1] > 0.3


def test_negative_control_thinning_that_the_ratio_forgets_is_found(bins, monkeypatch):
    """The weights of the mixture in place of those of the thinned mixture."""

    def forgetful(self, wi, wo, coin):
        log_q = self.mixture.log_prob(wi, wo)
        return coin < self._thinning(self.log_surrogate(wi, wo) - log_q), log_q

    monkeypatch.setattr(Screened, "thinned", forgetful)
    monkeypatch.setattr(auto, "choose", thinned_always)
    plan = Auto(block=8, anisotropic=False, fit_surrogate=lambda wi, wo, f: glossy(0.6))
    assert p_value(run(plan, BRDF, chains=3000, steps=40, seed=11), bins) < 1e-6


def test_the_space_of_local_moves_reaches_the_target(bins):
    proposal = PssNdf(0.4, anisotropic=False, sigma=0.2, global_share=0.3)
    assert p_value(run(Fixed(proposal), BRDF, chains=3000, steps=60), bins) > LEVEL


def test_delayed_acceptance_reaches_the_target_with_a_poor_surrogate(bins):
    inner = plain_proposal("pss_simple", SamplerConfig(**CONFIG), False)
    sampler = run(Delayed(inner, lambda wi, wo, f: glossy(0.6)), BRDF, chains=3000, steps=60)
    free = sampler.take_steps().id < 0
    assert p_value(sampler, bins) > LEVEL
    # the screen did settle proposals: more are free than lie below the horizon
    assert free[-3000:].mean() > free[:3000].mean() + 0.05


@pytest.mark.parametrize("name", ["pss_simple", "independence"])
def test_order_of_answers_does_not_matter_to_the_target(name, bins):
    sampler = run(plan_of(name, block=8), BRDF, chains=3000, steps=64, shuffle=True, seed=3)
    assert p_value(sampler, bins) > LEVEL


@pytest.mark.parametrize("name", ["pss_simple", "independence"])
def test_unbiased_noise_leaves_the_target_alone(name, bins):
    """Pseudo-marginal (Andrieu & Roberts 2009): the kept noisy value makes the chain exact."""
    sampler = run(plan_of(name, block=8), BRDF, chains=3000, steps=80, noise=0.5, seed=5)
    assert p_value(sampler, bins) > LEVEL


@pytest.mark.parametrize("name", ["pss_simple", "pss_vndf", "vmf_hd", "independence", "auto"])
def test_a_hole_in_the_support_is_left_out_and_nothing_else_changes(name):
    def reachable(wi, wo):
        return np.einsum("ni,ni->n", wi, wo) < np.cos(np.radians(30))

    bins = exact_bins(BRDF, thesis_target(), support=reachable)
    sampler = run(plan_of(name, block=8), BRDF, chains=3000, steps=64, reachable=reachable, seed=6)
    assert reachable(sampler.chains.wi, sampler.chains.wo).all()
    assert p_value(sampler, bins) > LEVEL


@pytest.mark.slow
@pytest.mark.parametrize("name", [*PLAIN, "auto"])
def test_anisotropic(name):
    brdf = glossy(0.5, 0.2)
    bins = exact_bins(brdf, thesis_target(), counts=(3, 3, 2), fine=(120, 40, 24), anisotropic=4)
    plan = plan_of(name, anisotropic=True, alpha_y=0.25, block=8)
    sampler = run(plan, brdf, chains=3000, steps=80, anisotropic=True, seed=7)
    assert p_value(sampler, bins) > LEVEL


@pytest.mark.parametrize(("power", "floor"), [(0.5, 0.0), (1.0, 0.2), (0.7, 0.1)])
def test_tempered_and_floored_targets(power, floor):
    target = Target(0, power, floor, 1)
    sampler = run(plan_of("pss_simple"), BRDF, chains=3000, steps=60, target=target, seed=8)
    assert p_value(sampler, exact_bins(BRDF, target)) > LEVEL


class NoJacobian(PssSimple):
    def place(self, u):
        wi, wo, _ = super().place(u)
        return wi, wo, np.zeros(len(wi))


class ThesisCosine(PssSimple):
    """The slip of thesis 3.3: one cosine too few."""

    def place(self, u):
        wi, wo, log_j = super().place(u)
        return wi, wo, log_j - np.log(np.cos(u[1] * np.pi / 2))


@pytest.mark.parametrize("wrong", [NoJacobian, ThesisCosine])
def test_negative_control_a_wrong_jacobian_is_found(wrong, bins):
    plan = Fixed(wrong(anisotropic=False, sigma=0.15, global_share=0.3, boundary="reflect"))
    assert p_value(run(plan, BRDF, chains=3000, steps=60), bins) < 1e-6


def test_negative_control_training_on_its_own_present_points_is_biased():
    """What the history rule is for: a chain on three states, its proposal fitted with or without the present one."""

    def share(exclude_present, runs=4000, steps=40):
        rng = np.random.default_rng(0)
        target = np.array([0.6, 0.3, 0.1])
        x = np.full(runs, 2)
        counts = np.zeros((runs, 3))
        rows = np.arange(runs)
        for _ in range(steps):
            seen = counts.copy()
            if exclude_present:
                seen[rows, x] = np.maximum(seen[rows, x] - 1, 0)
            q = seen + 0.3
            q /= q.sum(1, keepdims=True)
            y = (rng.random((runs, 1)) > np.cumsum(q, 1)).sum(1)
            a = target[y] * q[rows, x] / (target[x] * q[rows, y])
            move = rng.random(runs) < a
            # accepted: the old state joins the history; rejected: the proposal does
            joins = np.where(move, x, y)
            x = np.where(move, y, x)
            counts[rows, joins if exclude_present else x] += 1
        return (x == 0).mean(), np.sqrt(0.24 / runs)

    right, error = share(True)
    wrong, _ = share(False)
    assert abs(right - 0.6) < 4 * error
    assert abs(wrong - 0.6) > 6 * error


@pytest.mark.parametrize("anisotropic", [False, True])
@pytest.mark.parametrize("name", ["pss_simple", "pss_vndf", "pss_ndf", "vmf_hd"])
def test_log_jacobian_is_the_volume_of_the_map(name, anisotropic):
    """Against central differences; a turn about the normal stands for the azimuth that an isotropic map leaves out."""
    config = SamplerConfig(alpha=0.3, alpha_y=0.2 if anisotropic else None)
    if name == "pss_ndf":
        proposal = PssNdf(0.3, anisotropic=anisotropic, sigma=0.1, global_share=0)
    else:
        proposal = plain_proposal(name, config, anisotropic)
    rng = np.random.default_rng(1)
    n = 200
    u = proposal.propose(None, rng.uniform(0.1, 0.9, (proposal.uniforms, n)), np.zeros((proposal.normals, n)))[0]
    step = 1e-6

    def pair(x):
        return np.concatenate(proposal.to_directions(x), 1)

    if name == "vmf_hd":
        return _vmf_hd_volume(proposal, u)
    columns = []
    for k in range(len(u)):
        d = np.zeros((len(u), 1))
        d[k] = step
        columns.append((pair(u + d) - pair(u - d)) / (2 * step))
    if not anisotropic:
        p = pair(u)
        columns.append(np.stack([-p[:, 1], p[:, 0], 0 * p[:, 0], -p[:, 4], p[:, 3], 0 * p[:, 0]], -1))
    j = np.stack(columns, -1)
    volume = 0.5 * np.linalg.slogdet(np.einsum("nik,nil->nkl", j, j))[1]
    ratio = volume - proposal.log_jacobian(u)
    assert np.ptp(ratio) < 1e-5


def _vmf_hd_volume(proposal, u):
    from gonio.geometry import from_angles, to_angles

    step, columns = 1e-6, []
    h, d = to_angles(u[:3].T), to_angles(u[3:].T)
    base = np.stack([*h, *d])

    def pair(x):
        return np.concatenate(
            proposal.to_directions(np.concatenate([from_angles(x[0], x[1]).T, from_angles(x[2], x[3]).T])), 1
        )

    for k in range(4):
        e = np.zeros((4, 1))
        e[k] = step
        columns.append((pair(base + e) - pair(base - e)) / (2 * step))
    j = np.stack(columns, -1)
    volume = 0.5 * np.linalg.slogdet(np.einsum("nik,nil->nkl", j, j))[1]
    measure = np.log(np.sin(h[0]) * np.sin(d[0]))
    assert np.abs(volume - measure - proposal.log_jacobian(u)).max() < 1e-4


@pytest.mark.parametrize("anisotropic", [False, True])
@pytest.mark.parametrize("name", PLAIN[:-1])
def test_directions_round_trip(name, anisotropic):
    proposal = plain_proposal(name, SamplerConfig(alpha=0.2), anisotropic)
    rng = np.random.default_rng(2)
    u = proposal.propose(None, rng.uniform(0.01, 0.99, (proposal.uniforms, 500)), np.zeros((proposal.normals, 500)))[0]
    wi, wo = proposal.to_directions(u)
    a, b = proposal.to_directions(proposal.from_directions(wi, wo))
    ok = (wi[:, 2] > 0) & (wo[:, 2] > 0)
    assert np.abs(wi[ok, 2] - a[ok, 2]).max() < 1e-9 and np.abs(wo[ok, 2] - b[ok, 2]).max() < 1e-9
    assert np.abs(np.sum(wi * wo, 1) - np.sum(a * b, 1))[ok].max() < 1e-9
    if anisotropic:
        assert np.abs(wi - a)[ok].max() < 1e-8 and np.abs(wo - b)[ok].max() < 1e-8
