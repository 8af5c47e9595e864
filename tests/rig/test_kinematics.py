"""Poses and directions: the closed form is exact, in every branch, at the poles too."""

import numpy as np
import pytest

from gonio.geometry import from_angles, to_angles
from gonio.rig.kinematics.gantry import Gantry

NEAR = np.array([0.1, 0.2, 0.3, 0.4])


def pairs(n, seed=1):
    rng = np.random.default_rng(seed)
    return tuple(from_angles(np.arccos(rng.random(n)), rng.uniform(-np.pi, np.pi, n)) for _ in range(2))


def test_values():
    pose = np.radians([[30.0, 0, 60, 0], [-30, 0, 60, 0], [30, 90, 60, 90], [0, 10, 45, 100]])
    wi, wo = Gantry().forward(pose)
    theta_i, phi_i = np.degrees(to_angles(wi))
    theta_o, phi_o = np.degrees(to_angles(wo))
    np.testing.assert_allclose(theta_i, [30, 30, 30, 0], atol=1e-12)
    np.testing.assert_allclose(theta_o, [60, 60, 60, 45], atol=1e-12)
    np.testing.assert_allclose(phi_i[:3] % 360, [0, 180, 270], atol=1e-12)
    np.testing.assert_allclose(phi_o, [0, 0, 0, 90], atol=1e-12)


def test_forward_of_inverse_in_every_branch():
    wi, wo = pairs(1_000_000)
    for begin in range(0, len(wi), 100_000):
        part = slice(begin, begin + 100_000)
        poses = Gantry().inverse(wi[part], wo[part], NEAR)
        for b in range(4):
            a, c = Gantry().forward(poses[:, b])
            assert max(np.abs(a - wi[part]).max(), np.abs(c - wo[part]).max()) < 1e-9


def test_branches_differ():
    wi, wo = pairs(100)
    poses = Gantry().inverse(wi, wo, NEAR)
    assert np.abs(poses).max() <= np.pi * (1 + 1e-15)
    for a in range(4):
        for b in range(a):
            assert np.abs(poses[:, a] - poses[:, b]).max(-1).min() > 1e-6


def test_isotropic_branches_show_the_same_up_to_a_turn_and_a_mirror():
    wi, wo = pairs(1000)
    poses = Gantry().inverse_isotropic(wi, wo, NEAR)
    assert np.all(poses[:, :, 1] == NEAR[1])
    for b in range(8):
        a, c = Gantry().forward(poses[:, b])
        np.testing.assert_allclose(a[:, 2], wi[:, 2], atol=1e-12)
        np.testing.assert_allclose(c[:, 2], wo[:, 2], atol=1e-12)
        np.testing.assert_allclose((a * c).sum(-1), (wi * wo).sum(-1), atol=1e-12)
        turned = np.cross(a, c)[:, 2] * np.cross(wi, wo)[:, 2]
        assert np.all(turned > 0) if b < 4 else np.all(turned < 0)


@pytest.mark.parametrize("inverse", ["inverse", "inverse_isotropic"])
def test_at_a_pole_the_free_angle_stays(inverse):
    z, w = np.array([[0.0, 0, 1]]), from_angles([0.5], [1.0])
    solve = getattr(Gantry(), inverse)
    assert np.all(solve(z, w, NEAR)[..., 1] == NEAR[1])
    assert np.all(solve(w, z, NEAR)[..., 3] == NEAR[3]) or inverse == "inverse_isotropic"
    both = solve(z, z, NEAR)
    assert np.all(both[..., 1] == NEAR[1]) and np.all(np.abs(both[..., 3]) == NEAR[3])
    for pair in ((z, w), (w, z), (z, z)):
        a, c = Gantry().forward(solve(*pair, NEAR))
        np.testing.assert_allclose((a * c).sum(-1), (pair[0] * pair[1]).sum(), atol=1e-12)


def test_a_wrong_sign_is_noticed():
    """Negative control: azimuth taken against the turntable."""
    wi, wo = pairs(1000)
    poses = Gantry().inverse(wi, wo, NEAR)[:, 0]
    poses[:, 3] = -poses[:, 3]
    assert np.abs(Gantry().forward(poses)[1] - wo).max() > 0.1
