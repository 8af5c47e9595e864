"""Ask/tell: order and grouping of answers, state and restore, unmeasurable readings, hopeless supports."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import Known, glossy

from gonio.config import Material
from gonio.mcmc import NoSupport, make_sampler

BRDF = glossy(0.2)
PROPOSALS = ["pss_simple", "pss_vndf", "vmf_io", "vmf_hd", "independence", "mixture", "auto", "delayed"]


def sampler_of(proposal="pss_simple", *, channels=1, symmetry="isotropic", seed=1, reachable=None, **more):
    if proposal == "mixture":  # the plan whose target is the energy
        proposal, more = "auto", more | {"target": {**more.get("target", {}), "kind": "energy"}}
    material = Material.model_validate(
        {
            "name": "x",
            "channels": channels,
            "symmetry": symmetry,
            "seed": seed,
            "sampler": {"proposal": proposal, **more},
        }
    )
    return make_sampler(material, reachable, lambda wi, wo, f, sigma=None: Known(glossy(0.5)))


def drive(sampler, measurements, answer=BRDF.eval, rng=None, parts=1):
    """Answer until at least so many were made; rng shuffles, parts splits. The step log."""
    logs, made = [sampler.take_steps()], 0
    while made < measurements:
        batch = sampler.ask()
        order = np.arange(len(batch.ids)) if rng is None else rng.permutation(len(batch.ids))
        f = answer(batch.wi, batch.wo)
        for part in np.array_split(order, parts):
            sampler.tell(batch.ids[part], f[part])
        made += len(order)
        logs.append(sampler.take_steps())
    return type(logs[0]).concatenate(logs)


def same(a, b):
    return len(a) == len(b) and all(
        np.array_equal(x, y, equal_nan=x.dtype.kind == "f") for x, y in zip(vars(a).values(), vars(b).values())
    )


@pytest.mark.parametrize("proposal", PROPOSALS)
@pytest.mark.parametrize("chains", [1, 7])
def test_order_and_grouping_of_answers_change_nothing(proposal, chains):
    straight = drive(sampler_of(proposal, chains=chains), 600)
    shuffled = drive(sampler_of(proposal, chains=chains), 600, rng=np.random.default_rng(0), parts=4)
    assert same(straight, shuffled)


@pytest.mark.parametrize("proposal", PROPOSALS)
@pytest.mark.parametrize("symmetry", ["isotropic", "anisotropic"])
def test_restore_goes_on_bit_for_bit(proposal, symmetry):
    straight, stopped = (sampler_of(proposal, chains=3, symmetry=symmetry) for _ in range(2))
    drive(straight, 400)
    drive(stopped, 400)
    batch = stopped.ask()  # stopped in the middle of a round, some answers told
    half = len(batch.ids) // 2
    stopped.tell(batch.ids[:half], BRDF.eval(batch.wi[:half], batch.wo[:half]))
    before = stopped.take_steps()
    again = sampler_of(proposal, chains=3, symmetry=symmetry)
    again.restore(stopped.state())
    rest = drive(again, 300)
    whole = drive(straight, 300 + half)
    n = min(len(before) + len(rest), len(whole))
    joined = type(rest).concatenate([before, rest])
    assert n > 250
    assert np.array_equal(joined.state[:n], whole.state[:n]) and np.array_equal(
        joined.log_p[:n], whole.log_p[:n], equal_nan=True
    )
    assert np.array_equal(joined.wi[:n], whole.wi[:n])


def test_a_chain_does_not_depend_on_how_many_run_beside_it():
    one, many = (
        drive(sampler_of(chains=1, target={"floor": 0, "channels": 0}), 200),
        drive(sampler_of(chains=5, target={"floor": 0, "channels": 0}), 1000),
    )
    mine = many.wi[many.chain == 0]
    n = min(len(one), len(mine))
    assert np.array_equal(one.wi[:n], mine[:n])


def test_the_log_tells_free_from_measured_and_counts_every_step():
    sampler = sampler_of(chains=4)
    log = drive(sampler, 500)
    steps = log.step[log.step >= 0]
    assert np.array_equal(np.bincount(steps), np.full(steps.max() + 1, 4))
    free = log.id < 0
    below = (log.wi[:, 2] <= 0) | (log.wo[:, 2] <= 0)
    assert np.array_equal(free, below)
    assert not log.accepted[free].any()
    ids = log.id[~free]
    assert np.array_equal(np.sort(ids), np.arange(len(ids)))


def test_weights_turn_any_target_into_f_cos():
    """The mean of cos theta_h under f cos, from a tempered and floored chain by its stored weights."""
    from oracle import coordinates, exact_bins

    from gonio.mcmc.target import Target

    exact = exact_bins(BRDF, Target(0, 1.0, 0.0, 1)).mean[0]
    sampler = sampler_of("independence", chains=50, alpha=0.3, target={"channels": 0, "power": 0.5, "floor": 0.2})
    log = drive(sampler, 60_000)
    directions = {i: k for k, i in enumerate(log.id) if i >= 0}
    keep = (log.state >= 0) & (log.step > 20)
    row = np.array([directions[i] for i in log.state[keep]])
    wi, wo = log.wi[row], log.wo[row]
    w = (BRDF.eval(wi, wo)[:, 0] * wo[:, 2]) / np.exp(log.log_p[keep])
    x = np.cos(coordinates(wi, wo)[0])
    assert abs(np.sum(w * x) / w.sum() - exact) < 0.003
    assert abs(x.mean() - exact) > 0.01  # negative control: without the weights it is another mean


def test_told_twice_or_unasked_is_an_error_and_changes_nothing():
    sampler = sampler_of("independence")
    batch = sampler.ask()
    with pytest.raises(KeyError):
        sampler.tell([10_000], np.ones((1, 1)))
    sampler.tell(batch.ids[:1], np.ones((1, 1)))
    with pytest.raises(KeyError):
        sampler.tell(batch.ids[:1], np.ones((1, 1)))
    assert len(sampler.ask().ids) == len(batch.ids) - 1


def test_nan_readings_are_rejected_counted_and_never_enter_the_state():
    sampler = sampler_of(chains=2)
    rng = np.random.default_rng(0)

    def half_blind(wi, wo):
        f = BRDF.eval(wi, wo)
        f[rng.random(len(f)) < 0.5] = np.nan
        return f

    drive(sampler, 400, half_blind)
    assert np.isfinite(sampler.chains.f).all() and np.isfinite(sampler.chains.log_w).all()
    drive(sampler, 40, lambda wi, wo: np.full((len(wi), 1), np.nan))
    assert sampler.unmeasured_in_a_row >= 40
    drive(sampler, 2)
    assert sampler.unmeasured_in_a_row == 0


def test_a_rig_that_reaches_nothing_is_said_to():
    sampler = sampler_of(reachable=lambda wi, wo: np.zeros(len(wi), bool), target={"floor": 0, "channels": 0})
    with pytest.raises(NoSupport, match="stay-out"):
        sampler.ask()


def test_start_far_from_a_tiny_support_is_found():
    def reachable(wi, wo):
        return (wi[:, 2] > 0.98) & (wo[:, 2] > 0.98)

    sampler = sampler_of(reachable=reachable, chains=3)
    drive(sampler, 1500)
    assert sampler.chains.started.all()


def peak(alpha, scale=1.0):
    from gonio.brdf.models.microfacet import Ggx

    return Ggx(alpha, None, 1.0, weight=scale)


def finite_state(sampler):
    c = sampler.chains
    ok = c.started
    return all(np.isfinite(x[ok]).all() for x in (c.wi, c.wo, c.f, c.log_p)) and not any(
        np.isnan(x).any() for x in (c.log_p, c.log_w)
    )


@pytest.mark.parametrize("proposal", PROPOSALS)
@pytest.mark.parametrize("alpha", [1e-4, 1e-2, 1.0])
@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e12])
def test_peaks_of_any_width_and_height(proposal, alpha, scale):
    sampler = sampler_of(proposal, chains=2, alpha=max(alpha, 1e-4))
    drive(sampler, 150, peak(alpha, scale).eval)
    assert finite_state(sampler)


@pytest.mark.parametrize("proposal", PROPOSALS)
@pytest.mark.parametrize("f", ["zero nearly everywhere", "constant", "huge", "tiny", "negative"])
def test_strange_values_never_make_a_nan(proposal, f):
    def answer(wi, wo):
        n = len(wi)
        if f == "zero nearly everywhere":
            return np.where(wi[:, 2:] > 0.95, 1.0, 0.0)
        return np.full((n, 1), {"constant": 0.3, "huge": 1e300, "tiny": 1e-300, "negative": -0.01}[f])

    sampler = sampler_of(proposal, chains=2)
    with np.errstate(over="raise", invalid="raise", divide="ignore"):
        drive(sampler, 150, answer)
    assert finite_state(sampler)


def test_grazing_to_the_last_hundredth_of_a_degree():
    def reachable(wi, wo):
        return (wi[:, 2] < np.cos(np.radians(89))) & (wi[:, 2] > np.cos(np.radians(89.99)))

    sampler = sampler_of("auto", chains=2, reachable=reachable)
    drive(sampler, 100, peak(0.05).eval)
    assert finite_state(sampler)


@settings(max_examples=250, deadline=None)
@given(
    proposal=st.sampled_from(PROPOSALS),
    chains=st.integers(1, 4),
    channels=st.integers(1, 4),
    symmetry=st.sampled_from(["isotropic", "anisotropic"]),
    sigma=st.floats(1e-4, 1),
    share=st.floats(0, 1),
    kappa=st.floats(1e-3, 1e6),
    alpha=st.floats(1e-4, 1),
    block=st.integers(1, 16),
    power=st.floats(0.05, 1),
    floor=st.floats(0, 0.9),
    boundary=st.sampled_from(["wrap", "reflect"]),
    seed=st.integers(0, 2**31),
)
def test_any_config(
    proposal, chains, channels, symmetry, sigma, share, kappa, alpha, block, power, floor, boundary, seed
):
    target = {"power": power, "floor": floor}
    sampler = sampler_of(
        proposal, chains=chains, channels=channels, symmetry=symmetry, seed=seed, sigma=sigma, global_share=share,
        kappa=kappa, alpha=alpha, block=block, boundary=boundary, target=target,
    )  # fmt: skip
    rng = np.random.default_rng(seed)
    drive(sampler, 4, lambda wi, wo: rng.lognormal(0, 10, (len(wi), channels)))
    drive(sampler, 4, lambda wi, wo: rng.lognormal(0, 10, (len(wi), channels)))
    assert finite_state(sampler)
