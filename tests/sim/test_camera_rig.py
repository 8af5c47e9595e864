"""A rig whose detector is a camera: the real driver on an emulated sensor, from the pose to f."""

import json

import numpy as np
import pytest

from gonio.brdf.models.lambert import Lambert
from gonio.config import Material, load_config
from gonio.config.loader import ConfigError, parse_config
from gonio.config.plan import PlanConfig
from gonio.config.rig import FaultsConfig, RigConfig
from gonio.geometry import from_angles
from gonio.rig.errors import DeviceFault
from gonio.run.check import plan_of
from gonio.run.open_rig import open_rig
from gonio.run.start import resume, start
from tests.conftest import ROOT

CAMERA = load_config(ROOT / "configs/rigs/camera.yaml", RigConfig)
F = np.array([3.0, 0.3, 0.02])


def with_camera(config=CAMERA, sensor=None, **keys):
    """The config with other camera keys."""
    c = config.camera
    keys["sensor"] = c.sensor.model_copy(update=sensor or {})
    return config.model_copy(update={"camera": c.model_copy(update=keys)})


# a short ladder: half the frames
QUICK = with_camera(exposure_s=(0.0064, 0.0512))


def pairs(rig, n, seed=5, lowest=0.0):
    rng = np.random.default_rng(seed)
    cosines = [rng.uniform(lowest, 1, 3 * n) for _ in range(2)]
    wi, wo = (from_angles(np.arccos(c), rng.uniform(-np.pi, np.pi, 3 * n)) for c in cosines)
    ok = np.flatnonzero(rig.reachable(wi, wo))[:n]
    return wi[ok], wo[ok]


def gather(visits):
    seen = list(visits)
    out = {k: np.concatenate([getattr(v, k) for v in seen]) for k in ("ids", "wi", "wo", "f", "sigma", "saturated")}
    return {**out, "raw": [r for v in seen for r in v.raw]}


def test_f_comes_back_with_its_sigma():
    rig = open_rig(CAMERA, Lambert(np.pi * F), 3)
    got = gather(rig.visit(*pairs(rig, 120), np.arange(120)))
    assert (np.abs(np.median(got["f"] / F, 0) - 1) < [1e-3, 1e-3, 4e-3]).all()
    z = (got["f"] - F) / got["sigma"]
    assert np.abs(z.mean(0)).max() < 0.5  # common to all: the noise of the flat frame and of the dark ones
    assert 0.9 < z.std() < 1.25
    assert not got["saturated"].any()
    json.dumps(got["raw"])
    dim = np.argmin(got["wi"][:, 2] * got["wo"][:, 2])
    assert got["raw"][dim]["pixels"] < 800 * got["wo"][dim, 2] + 60
    assert {t for r in got["raw"] for t in r["exposures_s"]} >= {0.0512, 0.4096}


def test_the_region_follows_the_arm():
    """With a region that stayed where it is at the normal, grazing views would see the dark beside the patch."""
    rig = open_rig(with_camera(QUICK, lit_mm=4.5), Lambert(np.pi * F), 3)
    wi = from_angles(np.full(9, 0.5), 0.0)
    wo = from_angles(np.radians([5.0, 60.0, 80.0]).repeat(3), np.tile([2.0, 2.3, 2.6], 3))
    got = gather(rig.visit(wi, wo, np.arange(9)))
    np.testing.assert_allclose(got["f"][:, 0], 3.0, rtol=0.005)
    pixels = np.array([r["pixels"] for r in got["raw"]])
    np.testing.assert_allclose(pixels, 808 * got["wo"][:, 2], rtol=0.06)
    rig.detector.region = lambda: (slice(8, 40), slice(16, 48), np.ones((32, 32), bool))
    still = gather(rig.visit(wi[-1:], wo[-1:], np.arange(9, 10)))
    assert still["f"][0, 0] < 1.5


@pytest.mark.parametrize("bits", [8, 16])
def test_other_converters(bits):
    epc = {8: 32.0, 16: 0.25}[bits]
    rig = open_rig(with_camera(sensor={"bits": bits, "electrons_per_count": epc}), Lambert(np.pi * F), 3)
    got = gather(rig.visit(*pairs(rig, 20, lowest=0.2), np.arange(20)))
    # where the noise hides no half step, what is dim is rounded: 8 bits take brighter things
    clear = slice(None) if bits == 16 else slice(0, 2)
    np.testing.assert_allclose(np.median(got["f"] / F, 0)[clear], 1, atol=4e-3)


def test_a_resumed_run_is_the_same_to_the_last_bit():
    plan = PlanConfig(window=12, reference_every=9, dark_every=11)
    opened = lambda: open_rig(QUICK, Lambert(np.pi * F), 3, plan=plan, isotropic=True)
    whole = opened()
    wi, wo = pairs(whole, 20)
    ids = np.arange(20)
    expected = gather(whole.visit(wi, wo, ids))
    for cut in (3, 17):
        first = opened()
        visit = first.visit(wi, wo, ids)
        seen = [next(visit) for _ in range(cut)]
        state = json.loads(json.dumps(first.state()))
        second = opened()
        second.restore(state)
        left = np.setdiff1d(ids, np.concatenate([v.ids for v in seen]))
        got = gather([*seen, *second.visit(wi[left], wo[left], left)])
        assert got["raw"] == expected["raw"]
        assert all(np.array_equal(got[k], expected[k]) for k in ("ids", "wi", "wo", "f", "sigma")), cut


def test_a_dark_level_that_could_not_be_read_is_taken_again():
    """The dark is read wherever the arms happen to stand; from almost edge on, a coarse camera sees no patch."""
    coarse = with_camera(QUICK, focal_px=200.0)
    rig = open_rig(coarse, Lambert(np.pi * F), 3, plan=PlanConfig(tour=False))
    rig.drive(from_angles([0.3], [0.0]), from_angles([np.radians(86.0)], [2.0]))
    wi, wo = from_angles(np.full(3, 0.3), 0.0), from_angles(np.radians([85.0, 20.0, 20.0]), [2.0, 2.0, 2.3])
    f = gather(rig.visit(wi, wo, np.arange(3)))["f"]
    assert np.isnan(f[0]).all() and np.isfinite(f[2]).all()


def test_frames_that_never_come_are_a_fault_with_a_name():
    rig = open_rig(QUICK.model_copy(update={"faults": FaultsConfig(silent_detector=0.2)}), Lambert(np.pi * F), 3)
    with pytest.raises(DeviceFault, match="camera: delivers no frames"):
        gather(rig.visit(*pairs(rig, 40), np.arange(40)))
    assert not rig.light.lit


def test_too_bright_is_said():
    rig = open_rig(with_camera(exposure_s=(0.0512, 0.4096), sensor={"white_per_s": 1e6}), Lambert(np.pi * F), 3)
    got = gather(rig.visit(*pairs(rig, 5, lowest=0.5), np.arange(5)))
    assert got["saturated"].all() and np.isfinite(got["f"]).all() and np.isfinite(got["sigma"]).all()


MATERIAL = parse_config(
    "name: film\nsymmetry: isotropic\nchannels: [R, G, B]\ntruth: analytic_gloss\nbudget: {measurements: 40}\n"
    "sampler: {proposal: auto, chains: 4, block: 4}\n",
    Material,
)


@pytest.mark.parametrize("depth", ["devices", "wire"])
def test_a_camera_that_stops_delivering_ends_the_run_which_can_be_gone_on_with(tmp_path, depth):
    config = QUICK.model_copy(update={"depth": depth, "clock_scale": 1e5})
    whole = start(MATERIAL, config, tmp_path / "whole")
    whole()
    run = start(MATERIAL, config, tmp_path / "cut")
    rig = open_rig(config, run.truth, MATERIAL.seed, plan=MATERIAL.plan, isotropic=True)
    source = rig.detector.camera.source
    source.dies_after = source.delivered + 200
    with pytest.raises(DeviceFault, match="camera: delivers no frames; check its cable"):
        run(rig=rig)
    lamp = rig.light if depth == "devices" else rig.emulators.light.lamp
    assert not lamp.lit
    rig.close()
    run.close()
    again = resume(tmp_path / "cut")
    assert 0 < len(again.store.measured().id) < 40
    again()
    a, b = (r.store.measured() for r in (whole, again))
    assert np.array_equal(np.sort(a.id), np.sort(b.id)) and len(a.id) == 40
    order = np.argsort(a.id), np.argsort(b.id)
    assert np.array_equal(a.f[order[0]], b.f[order[1]]) and np.array_equal(a.seen[order[0]], b.seen[order[1]])
    for r in (whole, again):
        r.close()


def test_keys_that_do_not_fit_are_named():
    text = (ROOT / "configs/rigs/camera.yaml").read_text()
    for old, new, message in (
        ("region_mm: 4 ", "region_mm: 13 ", "camera.region_mm: the region reaches beyond the lit patch"),
        ("[0.0001, 0.0008,", "[0.0008, 0.0001,", "exposure_s: each must be longer"),
        ("channels: [2, 1, 0]", "channels: [2, 2, 0]", "channels: each plane once"),
        ("depth: devices", "depth: ideal", "detector: a rig of depth ideal has none"),
        ("depth: devices", "depth: real", "devices: a real rig needs a stage and the camera"),
        ("stay_out_deg: 8", "stay_out_deg: 8\nfaults: {spike: 0.1}", "faults.spike: only a photodiode has them"),
        ("discard_frames", "discard_frame", "did you mean discard_frames"),
    ):
        with pytest.raises(ConfigError) as e:
            parse_config(text.replace(old, new, 1), RigConfig)
        assert message in str(e.value)
    with pytest.raises(ConfigError, match="channels: film has 1, the camera of rig camera 3; name its planes"):
        plan_of(MATERIAL.model_copy(update={"channels": ("L",)}), CAMERA)
    assert "detector       camera, 3 channels, 5 exposures from 0.0001 to 0.4096 s" in plan_of(MATERIAL, CAMERA).text
    with pytest.raises(ConfigError, match=r"camera\.channels: rig camera names 3 planes, the truth has 1"):
        open_rig(CAMERA, Lambert([0.3]), 0)
