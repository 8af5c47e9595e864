"""The sweep against 50 digits in small, with negative controls; and whole runs."""

import numpy as np
import pytest

from gonio.bench.stability import runs
from gonio.bench.stability.cases import CASES, Inputs
from gonio.bench.stability.sweep import adversarial, errors
from gonio.brdf.models.abc import Abc
from gonio.brdf.models.microfacet import Ggx
from gonio.config import Material
from gonio.geometry import cos_theta_d, from_angles, half_vector, to_half_diff

mpmath = pytest.importorskip("mpmath", reason="needs the extra `study`")


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("case", CASES, ids=[c.name for c in CASES])
def test_within_its_domain_a_function_has_nine_digits(case, dtype):
    x = Inputs.of(adversarial(np.random.default_rng(2), 300), dtype)
    assert case.inside(x).mean() > 0.3
    assert errors(case, x).max() < 1e-9


def test_extended_numbers_and_fifty_digits_say_the_same():
    x = Inputs.of(adversarial(np.random.default_rng(3), 60))
    for case in CASES:
        if case.extended:
            exact = errors(case, x)
            assert np.abs(errors(case, x, "extended") - exact).max() < 0.3 * exact.max() + 1e-15, case.name


def test_negative_control_the_textbooks_forms_are_found():
    """D with cos^2 (a^2 - 1) + 1, and theta_h by acos: what this project does not do."""
    x = Inputs.of(adversarial(np.random.default_rng(2), 2000))
    by_name = {c.name: c for c in CASES}

    def textbook(x):
        h = half_vector(x.wi, x.wo)[:, 2]
        return x.alpha**2 / (np.pi * (h * h * (x.alpha**2 - 1) + 1) ** 2)

    right = by_name["StudentNdf.d"]
    case = type(right)("D", textbook, lambda m, a, wi, wo, u, v: _ggx_d(m, a, wi, wo), right.domain, right.inside)
    assert errors(case, x).max() > 1e-8
    case = type(right)("acos", lambda x: np.arccos(half_vector(x.wi, x.wo)[:, 2].clip(-1, 1)),
                       by_name["theta_h"].right, "", by_name["theta_h"].inside)  # fmt: skip
    assert errors(case, x).max() > 1e-3


def _ggx_d(m, a, wi, wo):
    from gonio.bench.stability import exact

    return exact.ggx_d(m, exact.half(m, wi, wo), a)


def test_float32_directions_keep_a_sharp_peak():
    """Directions from a renderer or a network are float32, 1e-7 off in length: D of alpha 1e-4 was a fifth off."""
    wi = from_angles(np.linspace(0.1, 1.5, 50), 0.0)
    wo = from_angles(np.linspace(0.1, 1.5, 50) + 1e-4, np.pi)
    single = wi.astype(np.float32), wo.astype(np.float32)
    double = tuple(w.astype(float) / np.linalg.norm(w.astype(float), axis=1, keepdims=True) for w in single)
    for brdf in (Ggx(1e-4, None, [0.5]), Abc([0.0], [1.0], 2e8, 2.0)):
        assert np.allclose(brdf.eval(*single), brdf.eval(*double), rtol=1e-9)
        assert np.allclose(brdf.pdf(*single), brdf.pdf(*double), rtol=1e-9)
    assert np.allclose(to_half_diff(*single)[0], to_half_diff(*double)[0], rtol=1e-9)


def test_cos_theta_d_between_opposite_ends_of_the_horizon():
    """The dot product wi.h loses its digits there; |wi + wo| / 2 does not."""
    wi = np.array([[1.0, 0.0, 1.7e-5], [0.6, 0.0, 0.8]])
    wo = np.array([[-0.999999996, -8.6e-5, 2e-5], [-0.8, 0.0, 0.6]])
    wi, wo = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (wi, wo))
    right = [float(mpmath.sqrt(sum((mpmath.mpf(a) + mpmath.mpf(b)) ** 2 for a, b in zip(*p))) / 2) for p in zip(wi, wo)]
    assert np.allclose(cos_theta_d(wi, wo), right, rtol=1e-14, atol=0)


def test_a_run_is_drawn_from_its_number():
    for k in range(40):
        rng, again = (np.random.default_rng([2024, k]) for _ in range(2))
        (truth, words), (_, same) = runs.material_of(rng), runs.material_of(again)
        assert words == same
        config = runs.config_of(rng, truth, "x.npz")
        assert config == runs.config_of(again, truth, "x.npz") and runs.rig_of(rng) == runs.rig_of(again)


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 4, 6, 8, 9])
def test_whole_runs(number):
    (row,) = runs.cell({"run": number})
    assert row["end"] in runs.GOOD, row


def test_what_is_no_number_is_found(monkeypatch):
    """A reconstruction that says NaN at one pair; one that raises what nobody foresaw."""
    from gonio.reconstruct.splines import auto

    monkeypatch.setattr(runs, "rig_of", lambda rng: runs.load_config(runs.find_config("ideal", "rigs"), runs.RigConfig))
    plain = {"name": "x", "budget": {"measurements": 40}}
    monkeypatch.setattr(
        runs, "config_of", lambda rng, t, path: Material.model_validate(plain | {"truth": path, "channels": t.channels})
    )
    whole = auto.AutoBrdf.std
    monkeypatch.setattr(auto.AutoBrdf, "std", lambda self, wi, wo: whole(self, wi, wo) * np.nan)
    assert runs.cell({"run": 5})[0]["end"] == "NaN"
    monkeypatch.setattr(auto.AutoBrdf, "std", lambda self, wi, wo: 1 / 0)
    (row,) = runs.cell({"run": 5})
    assert row["end"] == "crash" and "ZeroDivisionError" in row["why"]
