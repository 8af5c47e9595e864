"""Benchmarks of the chain: `python -m pytest tests/bench -o addopts= --benchmark-only`. Not part of the test suite."""

import numpy as np
import pytest

from gonio.bench.speed.throughput import Config, _rounds, _sampler, emcee_steps_per_second
from gonio.brdf.models.microfacet import Ggx

BRDF = Ggx(0.2)


@pytest.mark.parametrize("proposal", ["pss_simple", "pss_vndf", "vmf_io", "vmf_hd", "independence", "auto"])
def test_ask_and_tell_of_one_chain(benchmark, proposal):
    sampler = _sampler(proposal, 1)
    _rounds(sampler, BRDF, 20)

    def step():
        batch = sampler.ask()
        sampler.tell(batch.ids, np.full((len(batch.ids), 1), 0.3))

    benchmark(step)
    assert sampler.next_id > 0


@pytest.mark.parametrize("chains", [1, 64, 1024])
def test_rounds_of_many_chains(benchmark, chains):
    sampler = _sampler("pss_simple", chains)
    _rounds(sampler, BRDF, 20)
    benchmark(_rounds, sampler, BRDF, 64)
    assert sampler.step >= 64


def test_emcee_beside_it(benchmark):
    pytest.importorskip("emcee", reason="emcee is in the study extra")
    config = Config(study="throughput", rounds=64)
    assert benchmark.pedantic(emcee_steps_per_second, (BRDF, config), rounds=3) > 0


def test_ggx_eval(benchmark):
    rng = np.random.default_rng(0)
    w = rng.normal(size=(2, 1024, 3))
    w /= np.linalg.norm(w, axis=-1, keepdims=True)
    assert np.isfinite(benchmark(BRDF.eval, np.abs(w[0]), np.abs(w[1]))).all()
