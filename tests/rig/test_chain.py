"""The gimbal's closed form, chains of joints against closed forms, and rigs whose axes are not as drawn."""

import numpy as np
import pytest

from gonio.config import load_config
from gonio.config.loader import parse_config
from gonio.config.rig import RigConfig
from gonio.geometry import from_angles
from gonio.rig.build import envelope_of, gantry_chain, gimbal_chain, kinematics_of
from gonio.rig.kinematics.encoders import Encoders
from gonio.rig.kinematics.gantry import Gantry
from gonio.rig.kinematics.gimbal import Gimbal
from tests.conftest import ROOT

NEAR = np.array([0.1, 0.2, 0.3, 0.4])
TILTED = {
    "light": (0.01, 1, -0.02),
    "azimuth": (0.015, 0.01, 1),
    "detector": (-0.01, 1, 0.01),
    "turntable": (0, 0.02, 1),
}
SKEWED = {"yaw": (0.01, 0.0, 1), "tilt": (0.01, -1, 0.02), "roll": (1, 0.015, 0), "detector": (0, 0.01, 1)}


def pairs(n, seed=1, up_to=1.0):
    rng = np.random.default_rng(seed)
    return tuple(from_angles(up_to * np.arccos(rng.random(n)), rng.uniform(-np.pi, np.pi, n)) for _ in range(2))


def worst(kinematics, poses, wi, wo):
    error = 0.0
    for b in range(poses.shape[1]):
        a, c = kinematics.forward(poses[:, b])
        error = max(error, np.abs(a - wi).max(), np.abs(c - wo).max())
    return error


def test_gimbal_angles():
    wi, wo = Gimbal().forward(np.radians([[20.0, 30, 77, 50]]))
    r = np.radians
    np.testing.assert_allclose(wi[0, 2], np.cos(r(30)) * np.cos(r(20)), atol=1e-12)
    np.testing.assert_allclose(wo[0, 2], np.cos(r(30)) * np.cos(r(30)), atol=1e-12)
    np.testing.assert_allclose((wi * wo).sum(), np.cos(r(50)), atol=1e-12)


def test_gimbal_forward_of_inverse_in_every_branch():
    wi, wo = pairs(250_000)  # a million poses
    assert worst(Gimbal(), Gimbal().inverse(wi, wo, NEAR), wi, wo) < 1e-9


def test_gimbal_isotropic_keeps_the_roll():
    wi, wo = pairs(1000)
    poses = Gimbal().inverse_isotropic(wi, wo, NEAR)
    assert np.all(poses[:, :, 2] == NEAR[2])
    for b in range(poses.shape[1]):
        a, c = Gimbal().forward(poses[:, b])
        for x, y in ((a[:, 2], wi[:, 2]), (c[:, 2], wo[:, 2]), ((a * c).sum(-1), (wi * wo).sum(-1))):
            np.testing.assert_allclose(x, y, atol=1e-9)


def test_gimbal_at_retro_reflection_and_normal_incidence():
    w, z = from_angles([0.4], [0.7]), np.array([[0.0, 0, 1]])
    for pair in ((w, w), (z, w), (w, z), (z, z)):
        poses = Gimbal().inverse(*pair, NEAR)
        assert np.isfinite(poses).all() and worst(Gimbal(), poses, *pair) < 1e-9


@pytest.mark.parametrize("closed, chain", [(Gantry(), gantry_chain({})), (Gimbal(), gimbal_chain({}))])
def test_a_chain_of_nominal_axes_is_the_closed_form(closed, chain):
    order = [closed.names.index(n) for n in chain.names]
    pose = np.random.default_rng(0).uniform(-3, 3, (200, 4))
    for a, b in zip(closed.forward(pose), chain.forward(pose[:, order])):
        np.testing.assert_allclose(a, b, atol=1e-12)


@pytest.mark.parametrize("chain", [gantry_chain(TILTED), gimbal_chain(SKEWED)], ids=["gantry", "gimbal"])
def test_tilted_axes_are_solved_to_a_microradian(chain):
    wi, wo = pairs(2000, up_to=0.9)
    apart = np.degrees(np.arccos(np.clip((wi * wo).sum(-1), -1, 1))) > 8
    poses = chain.inverse(wi, wo, NEAR)
    solved = np.isfinite(poses).all(-1)
    assert solved[apart].any(1).mean() > 0.995
    for b in range(poses.shape[1]):
        ok = solved[:, b]
        assert worst(chain, poses[ok, b : b + 1], wi[ok], wo[ok]) < 1e-6
    plain = (Gantry() if chain.nearest.names[0] == "light" else Gimbal()).inverse(wi, wo, NEAR)
    order = [chain.nearest.names.index(n) for n in chain.names]
    assert worst(chain, plain[:, :1, order], wi, wo) > 1e-3  # negative control: the tilts matter


def test_isotropic_poses_of_a_tilted_rig_show_the_same():
    chain = gantry_chain(TILTED)
    wi, wo = pairs(300, up_to=0.9)
    poses = chain.inverse_isotropic(wi, wo, NEAR)
    for b in range(poses.shape[1]):
        ok = np.isfinite(poses[:, b]).all(-1)
        a, c = chain.forward(poses[ok, b])
        np.testing.assert_allclose(a[:, 2], wi[ok, 2], atol=1e-6)
        np.testing.assert_allclose((a * c).sum(-1), (wi * wo)[ok].sum(-1), atol=1e-6)


def test_offsets_are_taken_off():
    rig = Encoders(Gantry(), np.radians([1.0, -2, 3, 170]))
    wi, wo = pairs(1000)
    poses = rig.inverse(wi, wo, NEAR)
    assert worst(rig, poses, wi, wo) < 1e-12 and np.abs(poses).max() <= np.pi + 1e-12
    a, _ = rig.forward(np.radians([[1.0, -2, 3, 170]]))
    np.testing.assert_allclose(a[0], [0, 0, 1], atol=1e-12)


def test_a_chain_from_yaml():
    text = """
name: odd
depth: ideal
kinematics:
  kind: chain
  nearest: gantry
  light: [{name: light, axis: [0, 1, 0.01]}]
  detector: [{name: azimuth, axis: [0, 0.01, 1]}, {name: detector, axis: [0, 1, 0]}]
  sample: [{name: turntable, axis: [0, 0, 1]}]
axes:
  light: {lower_deg: -90, upper_deg: 90, counts_per_turn: 0}
  turntable: {lower_deg: -180, upper_deg: 180, counts_per_turn: 0, offset_deg: 2}
  detector: {lower_deg: -90, upper_deg: 90, counts_per_turn: 0}
  azimuth: {lower_deg: -180, upper_deg: 180, counts_per_turn: 0}
"""
    envelope = envelope_of(parse_config(text, RigConfig))
    assert envelope.kinematics.names == ("light", "turntable", "azimuth", "detector")
    wi, wo = pairs(200, up_to=0.8)
    assert envelope.reachable(wi, wo).mean() > 0.95
    assert worst(envelope.kinematics, envelope.kinematics.inverse(wi, wo, NEAR)[:, :1], wi, wo) < 1e-6


def test_a_redundant_chain_is_solved_too():
    """Five joints: the light arm stands on an azimuth of its own."""
    sim = load_config(ROOT / "configs/rigs/ideal.yaml", RigConfig)
    text = {
        "kind": "chain",
        "light": [{"name": "boom", "axis": (0, 0, 1)}, {"name": "light", "axis": (0, 1, 0)}],
        "detector": [{"name": "azimuth", "axis": (0, 0, 1)}, {"name": "detector", "axis": (0, 1, 0)}],
        "sample": [{"name": "turntable", "axis": (0, 0, 1)}],
    }
    axes = {k: a.model_dump() for k, a in sim.axes.items()} | {"boom": sim.axes["azimuth"].model_dump()}
    config = RigConfig(name="five", depth="ideal", kinematics=text, axes=axes)
    kinematics = kinematics_of(config)
    wi, wo = pairs(200)
    near = np.full(5, 0.3)
    assert worst(kinematics, kinematics.inverse(wi, wo, near), wi, wo) < 1e-6
