"""Rigs that are not as drawn in anything a geometry calibration may say: forward, inverse, and what each part does."""

import datetime as dt

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gonio.config import load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.geometry import unit
from gonio.rig.build import backlash_of, chain_of, kinematics_of
from gonio.rig.calibration import GeometryCalibration
from gonio.rig.kinematics.encoders import Encoders
from gonio.rig.kinematics.gantry import Gantry

SIM = load_config(find_config("sim", "rigs"), RigConfig)
BENT = GeometryCalibration(
    id="-",
    date=dt.datetime(2026, 1, 1, tzinfo=dt.UTC),
    rig="sim",
    offsets_deg={"light": 1.0, "detector": -2.0, "azimuth": 0.7, "turntable": 1.5},
    axes={"light": (0.01, 1, -0.02), "azimuth": (0.015, 0.01, 1), "turntable": (0, 0.02, 1)},
    eccentricity_deg={"light": (0.1, -0.05, 0.08, 0.02), "azimuth": (0.1, 0.1, -0.1, 0.05)},
    centres={"light": (0.001, -0.002, 0.0015), "detector": (-0.001, 0.0005, 0.002)},
    height=0.0012,
    lie_deg=(0.8, -0.5),
    backlash_deg={"light": 0.2, "detector": -0.1},
)
NEAR = np.array([0.1, 0.2, 0.3, 0.4])


def poses(n, seed=0):
    return np.radians(np.random.default_rng(seed).uniform([-80, -170, -80, -170], [80, 170, 80, 170], (n, 4)))


def by_hand(q):
    """wi, wo of one encoder pose of the bent gantry, by SciPy's rotations: an independent source."""
    names = ("light", "turntable", "detector", "azimuth")
    e = q - np.radians([BENT.offsets_deg[n] for n in names])
    for k, n in enumerate(names):
        s1, c1, s2, c2 = np.radians(BENT.eccentricity_deg.get(n, (0, 0, 0, 0)))
        e[k] -= s1 * np.sin(e[k]) + c1 * np.cos(e[k]) + s2 * np.sin(2 * e[k]) + c2 * np.cos(2 * e[k])
        # the right side's e[k] is the one before: Python evaluates it first
    turn = lambda n, nominal, angle: Rotation.from_rotvec(angle * unit(np.array(BENT.axes.get(n, nominal), float)))
    light = turn("light", (0, 1, 0), e[0]).apply([0, 0, 1]) + BENT.centres["light"]
    arm = turn("azimuth", (0, 0, 1), e[3]) * turn("detector", (0, 1, 0), e[2])
    seen = arm.apply([0, 0, 1]) + np.array(BENT.centres["detector"])
    frame = turn("turntable", (0, 0, 1), e[1]) * Rotation.from_rotvec(np.radians([*BENT.lie_deg, 0]))
    up = np.array([0, 0, BENT.height])
    return unit(frame.inv().apply(light) - up), unit(frame.inv().apply(seen) - up)


def test_forward_is_what_rotations_say():
    rig = kinematics_of(SIM, BENT)
    for q in poses(50):
        wi, wo = rig.forward(q)
        right_i, right_o = by_hand(q.copy())
        np.testing.assert_allclose(wi, right_i, atol=1e-13)
        np.testing.assert_allclose(wo, right_o, atol=1e-13)


def test_what_it_is_asked_for_it_shows():
    rig = kinematics_of(SIM, BENT)
    wi, wo = rig.forward(poses(200, 3))
    apart = (np.minimum(wi[:, 2], wo[:, 2]) > 0.2) & (np.linalg.norm(wi - wo, axis=1) > 0.3)
    found = rig.inverse(wi[apart], wo[apart], NEAR)
    solved = np.isfinite(found).all(-1)
    assert solved.any(1).all()
    a, b = rig.forward(np.nan_to_num(found))
    off = np.maximum(np.linalg.norm(a - wi[apart, None], axis=-1), np.linalg.norm(b - wo[apart, None], axis=-1))
    assert off[solved].max() < 1e-7
    plain = kinematics_of(SIM).inverse(wi[apart], wo[apart], NEAR)
    a, _ = rig.forward(plain)
    assert np.linalg.norm(a - wi[apart, None], axis=-1).min() > 1e-3  # negative control


def test_the_jacobian_is_the_derivative():
    chain = chain_of(SIM, BENT)
    q = poses(40, 4)
    _, _, jacobian = chain._solve_forward(q, jacobian=True)
    for k in range(4):
        step = np.where(np.arange(4) == k, 1e-6, 0)
        there, back = (np.concatenate(chain.forward(q + s), -1) for s in (step, -step))
        np.testing.assert_allclose(jacobian[:, :, k], (there - back) / 2e-6, atol=1e-9)


def test_encoders_turn_back():
    rig = Encoders(Gantry(), np.radians([1.0, -2, 3, 0.5]), np.radians(np.full((4, 4), 0.15)))
    q = poses(500, 5)
    np.testing.assert_allclose(rig.encoder(rig.joint(q)), q, atol=1e-14)
    assert np.isnan(rig.encoder(np.full(4, np.nan))).all()
    assert np.abs(rig.joint(q) - q + np.radians([1.0, -2, 3, 0.5])).max() > np.radians(0.2)


@pytest.mark.parametrize("part", ["offsets_deg", "axes", "eccentricity_deg", "centres", "height", "lie_deg"])
def test_each_part_counts(part):
    empty = {"height": 0.0, "lie_deg": (0.0, 0.0)}.get(part, {})
    less = kinematics_of(SIM, BENT.model_copy(update={part: empty}))
    a, b = kinematics_of(SIM, BENT).forward(poses(20)), less.forward(poses(20))
    assert max(np.abs(x - y).max() for x, y in zip(a, b)) > 5e-4


def test_backlash_adds_up_and_is_never_negative():
    axes = {n: a.model_copy(update={"backlash_deg": 0.3}) for n, a in SIM.axes.items()}
    config = SIM.model_copy(update={"axes": axes})
    np.testing.assert_allclose(np.degrees(backlash_of(config, BENT)), [0.5, 0.3, 0.2, 0.3])


def test_a_cameras_arm_turns_with_eccentric_encoders():
    from gonio.rig.build import view_of

    q = np.radians([0.0, 30.0, 40.0, 50.0])
    spot = np.array([[0.003, 0.001, 0.0]])
    straight = BENT.model_copy(update={"eccentricity_deg": {}})
    moved = view_of(SIM, BENT).project(spot, q) - view_of(SIM, straight).project(spot, q)
    assert np.abs(moved).max() > 0.01
    joint = Encoders(
        Gantry(), np.zeros(4), np.radians([BENT.eccentricity_deg.get(n, (0.0,) * 4) for n in SIM.axis_names])
    )
    e = q - np.radians([1.0, 1.5, -2.0, 0.7])
    there = joint.joint(e) + np.radians([1.0, 1.5, -2.0, 0.7])
    np.testing.assert_allclose(
        view_of(SIM, BENT).project(spot, q), view_of(SIM, straight).project(spot, there), atol=1e-9
    )
