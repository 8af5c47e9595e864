"""Hidden errors: what they do is what they say, both depths have the same, and only the simulation can see them."""

import ast
from pathlib import Path

import numpy as np
import pytest

from gonio.brdf.models.lambert import Lambert
from gonio.config import ConfigError, load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.config.world import World
from gonio.geometry import from_angles
from gonio.rig.build import envelope_of
from gonio.run.open_rig import open_rig
from sim.world import ROOM_S, Hidden, TrueRig

ROOT = Path(__file__).resolve().parents[1]
SIM = load_config(find_config("sim", "rigs"), RigConfig)
WIRE = load_config(find_config("wire", "rigs"), RigConfig)


def with_world(config=SIM, **world):
    return RigConfig.model_validate({**config.model_dump(), "world": world})


def poses(n=100, seed=0):
    return np.radians(np.random.default_rng(seed).uniform([-80, -180, -80, -180], [80, 180, 80, 180], (n, 4)))


def off_deg(true, q):
    """Angles between what the rig shows and what it is believed to show, (2 n,)."""
    believed = envelope_of(SIM).kinematics.forward(q)
    seen = [np.array(w) for w in zip(*[true.seen(p)[:2] for p in q])]
    return np.degrees(
        np.concatenate([2 * np.arcsin(np.linalg.norm(a - b, axis=1) / 2) for a, b in zip(believed, seen)])
    )


def test_a_world_with_nothing_in_it_changes_nothing():
    true, q = TrueRig(with_world(), 3), poses()
    assert off_deg(true, q).max() < 1e-10
    assert all(true.seen(p)[2] == 1 for p in q)
    light = np.array([0.2, 1.0, 3.0])
    assert np.array_equal(true.signal(light, 5000.0, True), light) and true.dark(1e-3, 5000.0) == 0
    assert np.array_equal(true.converted(light, np.array([0, 1, 2]), np.ones(3)), light)


@pytest.mark.parametrize(
    ("world", "least", "most"),
    [
        ({"offsets_deg": {"light": 1.5}}, 1.5, 1.5),
        ({"tilts_deg": {"light": (1.0, 0)}}, 0.5, 2.0),
        ({"eccentricity_deg": {"detector": (0.15, 0)}}, 0.1, 0.15),
        ({"axes_miss_mm": {"light": (0, 2.0, 0)}}, 0.25, 0.29),
        ({"sample_tilt_deg": (0.7, 0)}, 0.6, 0.7),
        ({"sample_height_mm": 2.0}, 0.25, 0.29),
    ],
)
def test_each_error_turns_directions_by_what_it_says(world, least, most):
    largest = off_deg(TrueRig(with_world(**world), 3), poses(300)).max()
    assert least - 0.01 < largest < most + 0.01


def test_an_offset_is_found_again_by_whoever_knows_it():
    """The belief corrected by it is the truth: the sign is that of `offset_deg`."""
    true = TrueRig(with_world(offsets_deg={"light": 1.5, "azimuth": -2.0}), 3)
    axes = {
        n: a.model_copy(update={"offset_deg": {"light": 1.5, "azimuth": -2.0}.get(n, 0)}) for n, a in SIM.axes.items()
    }
    q = poses(50)
    believed = envelope_of(SIM.model_copy(update={"axes": axes})).kinematics.forward(q)
    for k, p in enumerate(q):
        wi, wo, _ = true.seen(p)
        assert np.allclose(wi, believed[0][k], atol=1e-12) and np.allclose(wo, believed[1][k], atol=1e-12)


def test_signal_errors():
    true = TrueRig(with_world(gain=(1.1,), drift_per_h=0.01, stray=1e-4, dark_per_k=0.05, nonlinearity=0.03), 1)
    light = np.array([0.5])
    assert true.signal(light, 3600.0, True) == pytest.approx(1.1 * 1.01 * 0.5001)
    assert true.signal(light, 3600.0, 0.25) == pytest.approx(1.1 * 1.01 * 0.500025)  # stray light is the lamp's
    assert true.signal(light, 3600.0, False) == pytest.approx(1.1 * 1.01 * 0.5)
    assert true.dark(1e-3, ROOM_S / 4) == pytest.approx(1e-3 * 0.05 * 1.5)
    assert true.converted(light, np.array([0]), np.array([1.0])) == pytest.approx(0.5 * (1 + 0.03 * 0.5))
    ratios = TrueRig(with_world(range_ratios=(1.02, 0.97)), 1)
    assert ratios.converted(light, np.array([2]), np.array([1.0])) == pytest.approx(0.5 * 0.97)
    beams = TrueRig(with_world(beam_deg={"light": (3.0, 0)}), 1)
    assert beams.seen(poses(1)[0])[2] == pytest.approx(np.exp(-0.5))
    polar = TrueRig(with_world(polarisation=0.2), 1)
    shares = [polar.seen(p)[2] for p in np.radians([[40, 0, 40, 0], [40, 0, 40, 90], [40, 0, 40, 180], [0, 0, 40, 90]])]
    assert shares == pytest.approx([1.04, 0.96, 1.04, 1.0])


def test_a_seed_draws_all_within_its_widths_and_a_key_given_changes_no_other():
    drawn = [Hidden.of(World(seed=s), SIM, 3) for s in range(200)]
    offsets = np.degrees([h.offsets for h in drawn])
    assert np.abs(offsets).max() <= 2 and offsets.std() == pytest.approx(2 / np.sqrt(3), rel=0.1)
    assert np.degrees([h.backlash for h in drawn]).max() <= 0.25 and np.min([h.backlash for h in drawn]) >= 0
    assert np.abs(np.array([h.gain for h in drawn]) - 1).max() <= 0.1
    given = Hidden.of(World(seed=7, offsets_deg={"light": 1.0}, stray=0.0), SIM, 3)
    assert np.degrees(given.offsets).tolist() == [1.0, 0, 0, 0] and given.stray == 0
    for key in ("tilts", "backlash", "eccentric", "gain", "ratios", "polarisation"):
        assert np.array_equal(getattr(given, key), getattr(drawn[7], key))


@pytest.mark.parametrize("config", [SIM, WIRE.model_copy(update={"clock_scale": 400.0})], ids=["devices", "wire"])
def test_both_depths_show_the_same_world(config):
    world = {"seed": 3, "backlash_deg": {}, "drift_per_h": 0.0, "dark_per_k": 0.0}
    values = {}
    theta = np.radians([20.0, 40, 60])
    wi, wo = from_angles(theta, np.zeros(3)), from_angles(theta[::-1] * 0.5, np.full(3, 2.0))
    quiet = {**config.photodiode.model_dump(), "shot_noise": 0.0, "read_noise": 0.0}
    config = RigConfig.model_validate({**config.model_dump(), "photodiode": quiet})
    for name, c in (("plain", config), ("wrong", with_world(config, **world))):
        rig = open_rig(c, Lambert([0.3, 0.2, 0.1]), 1, isotropic=False)
        try:
            values[name] = np.concatenate([v.f for v in rig.visit(wi, wo, np.arange(3))])
        finally:
            rig.close()
    ratio = values["wrong"] / values["plain"]
    gain = TrueRig(with_world(config, **world), 3).hidden.gain
    assert np.abs(ratio.mean(0) / gain - 1).max() < 0.08  # cosines, beams, ranges: some percent
    assert ratio.std(0).min() > 1e-3


def test_nobody_outside_the_simulation_can_see_it():
    def looks(path):
        tree = ast.parse(path.read_text())
        names = {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute)}
        imported = {a.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names}
        modules = {n.module for n in ast.walk(tree) if isinstance(n, ast.ImportFrom)}
        return "world" in names or "World" in imported or "sim.world" in modules

    files = [p for room in ("gonio", "drivers", "calibration") for p in (ROOT / room).rglob("*.py")]
    allowed = {ROOT / "gonio" / "config" / "rig.py", ROOT / "gonio" / "config" / "world.py"}
    allowed.add(ROOT / "gonio" / "bench" / "accuracy" / "calibrated_rig.py")  # the referee of calibrations
    allowed.add(ROOT / "gonio" / "bench" / "stability" / "runs.py")  # draws rigs with hidden errors
    assert {p for p in files if looks(p)} - allowed == set()
    assert looks(ROOT / "sim" / "rig.py")  # the test sees what it looks for


@pytest.mark.parametrize(
    ("depth", "world", "what"),
    [
        ("ideal", {"seed": 1}, "world: a rig of depth ideal"),
        ("devices", {"offsets_deg": {"lamp": 1}}, "world.offsets_deg.lamp: no such part"),
        ("devices", {"range_ratios": [1.0]}, "world.range_ratios: 2 wanted"),
        ("devices", {"sees": 1}, "sees"),
    ],
)
def test_bad_worlds_are_named(tmp_path, depth, world, what):
    import yaml

    text = yaml.safe_load(find_config("sim", "rigs").read_text()) | {"depth": depth, "world": world}
    (tmp_path / "rig.yaml").write_text(yaml.safe_dump(text))
    with pytest.raises(ConfigError, match=what):
        load_config(tmp_path / "rig.yaml", RigConfig)


def test_the_rig_that_ships_is_wrong_and_runs_alike_twice():
    c = load_config(find_config("uncalibrated", "rigs"), RigConfig)
    assert off_deg(TrueRig(c, 3), poses()).max() > 1
    found = []
    for _ in range(2):
        rig = open_rig(c, Lambert([0.3, 0.2, 0.1]), 5, isotropic=True)
        wi = from_angles(np.radians([10.0, 50]), np.zeros(2))
        found.append(np.concatenate([v.f for v in rig.visit(wi, wi[::-1] * [-1, 1, 1], np.arange(2))]))
        rig.close()
    assert np.array_equal(*found)


def test_gains_for_other_channels_are_named():
    with pytest.raises(ConfigError, match=r"world.gain: 2 factors for 3 channels"):
        open_rig(with_world(gain=(1.0, 1.1)), Lambert([0.3, 0.2, 0.1]), 1, isotropic=True)
