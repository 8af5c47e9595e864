"""The first line of a report says whether the result is good, and what to do."""

from dataclasses import replace

import numpy as np
import pytest

from gonio.brdf import Ggx, Lambert, Mixture
from gonio.config.material import Material
from gonio.geometry import from_angles
from gonio.reconstruct import Samples, reconstruct
from gonio.reconstruct.splines.symmetry import Alignment
from gonio.render.verdict import verdict

GLOSSY = Mixture([Ggx(0.1, weight=[0.5, 0.4, 0.3]), Lambert([0.05, 0.2, 0.4])])


NONE = Alignment()


def measured(n: int, off: Alignment = NONE) -> Samples:
    rng = np.random.default_rng(1)
    wi = from_angles(np.arcsin(np.sqrt(0.98 * rng.random(2 * n))), 2 * np.pi * rng.random(2 * n))
    wo, _ = GLOSSY.sample(wi, rng.random((2 * n, 2)))
    up = wo[:, 2] > 0.02
    wi, wo = wi[up][:n], wo[up][:n]
    f = GLOSSY.eval(*off.turned(wi, wo))
    return Samples.of(wi, wo, f * (1 + 0.005 * rng.standard_normal(f.shape)), 0.005 * f)


def material(goal=None) -> Material:
    return Material.model_validate({"name": "m", "channels": ["R", "G", "B"], "stop": {"energy_error": goal}})


@pytest.fixture(scope="module")
def few():
    s = measured(150)
    return s, reconstruct(s)


def test_good(few):
    v = verdict(few[1], few[0], material(0.2))
    assert (
        v.grade == "good" and v.line.startswith("Good: estimated energy error") and v.findings == [] and v.more is None
    )


def test_not_yet_says_how_many_more(few):
    v = verdict(few[1], few[0], material(0.001))
    assert v.grade == "not yet" and v.error > 0.001 and v.more > 50
    assert "more measurements" in v.line or "falls slowly" in v.line
    if "budget.measurements=" in v.line:
        assert int(v.line.split("budget.measurements=")[1].split("`")[0]) >= 150 + v.more


def test_without_a_goal_three_percent(few):
    assert verdict(few[1], few[0], material()).goal == 0.03


def test_a_model_that_does_not_judge_itself_is_judged_at_the_samples(few):
    s = few[0]
    v = verdict(Lambert(np.pi * s.f.mean(0)), s, material())
    assert v.grade == "unusable" and v.line.startswith("Do not use")


def test_what_is_wrong_is_named(few):
    s = replace(few[0], saturated=np.arange(150) < 7)
    assert any("7 of 150 readings were saturated" in f for f in verdict(few[1], s, material()).findings)
    turned = measured(800, Alignment(0, 0, 4.0))
    found = verdict(reconstruct(turned), turned, material(), failed=20).findings
    assert any("azimuth of 4" in f or "azimuth of 3.9" in f for f in found), found
    assert "20 readings gave no value." in found
