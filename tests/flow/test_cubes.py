"""Coordinates: round trips, Jacobians against finite differences of the directions themselves."""

import numpy as np
import pytest

from gonio.flow.cubes import make_cube
from gonio.geometry import above_horizon

NAMES = ("raw", "flat", "vndf", "half")
BOTH = [(n, a) for n in NAMES for a in (False, True)]


def inner(cube, n=4000, seed=3):
    """Points away from faces, horizon and poles, where finite differences mean something."""
    x = 0.02 + 0.96 * np.random.default_rng(seed).random((n, cube.dimensions))
    wi, wo = cube.to_directions(x)
    keep = (np.minimum(wi[:, 2], wo[:, 2]) > 0.05) & (np.maximum(wi[:, 2], wo[:, 2]) < 0.999)
    return x[keep]


@pytest.mark.parametrize("name, anisotropic", BOTH)
def test_round_trip(name, anisotropic):
    cube = make_cube(name, 0.1, anisotropic)
    x = inner(cube)
    back = cube.from_directions(*cube.to_directions(x))
    apart = np.abs(back - x)
    assert np.minimum(apart, 1 - apart if anisotropic else apart).max() < 1e-9


@pytest.mark.parametrize("name, anisotropic", BOTH)
def test_jacobian_by_differences(name, anisotropic):
    cube = make_cube(name, 0.1, anisotropic)
    x = inner(cube, 800)
    analytic = np.exp(cube.log_jacobian(x, *cube.to_directions(x)))
    assert analytic == pytest.approx(numeric_jacobian(cube, x), rel=2e-3)
    # negative control: another cube's Jacobian is not this one's
    other = make_cube("flat" if name != "flat" else "raw", 0.1, anisotropic)
    wi, wo = cube.to_directions(x)
    wrong = np.exp(other.log_jacobian(other.from_directions(wi, wo), wi, wo))
    assert np.median(np.abs(wrong / analytic - 1)) > 0.05


def numeric_jacobian(cube, x, step=1e-5):
    """|d(wi, wo)/d(x, azimuth)|: Gram determinant of the six components of the pair by the four coordinates."""
    columns = []
    for k in range(cube.dimensions):
        d = np.zeros(cube.dimensions)
        d[k] = step
        columns.append(
            (np.concatenate(cube.to_directions(x + d), 1) - np.concatenate(cube.to_directions(x - d), 1)) / (2 * step)
        )
    if cube.dimensions == 3:
        wi, wo = cube.to_directions(x)
        turn = lambda w: np.stack([-w[:, 1], w[:, 0], 0 * w[:, 2]], 1)
        columns.append(np.concatenate([turn(wi), turn(wo)], 1))
    j = np.stack(columns, -1)
    return np.sqrt(np.linalg.det(j.transpose(0, 2, 1) @ j))


def test_no_point_of_the_half_cube_lies_below_the_horizon():
    rng = np.random.default_rng(4)
    for anisotropic in (False, True):
        cube = make_cube("half", 0.1, anisotropic)
        x = rng.random((50_000, cube.dimensions))
        x[:200] = np.round(x[:200])
        x[:, 2] = np.minimum(x[:, 2], 1 - 1e-9)  # the horizon of wi itself
        wi, wo = cube.to_directions(x)
        assert above_horizon(wi, wo).all()
        assert np.abs(np.linalg.norm(wo, axis=1) - 1).max() < 1e-9
    below = make_cube("raw", 0.1).to_directions(rng.random((1000, 3)))  # negative control
    assert not above_horizon(*below).all()
