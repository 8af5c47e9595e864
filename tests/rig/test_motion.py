"""The trapezoid, against its textbook form and by integration."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from gonio.rig.motion.profile import move_time, progress

some = st.floats(1e-3, 1e3)


@given(some, some, some)
def test_one_axis(d, v, a):
    expected = 2 * np.sqrt(d / a) if d < v**2 / a else d / v + v / a
    np.testing.assert_allclose(move_time(np.array([d]), np.array([v]), np.array([a])), expected, rtol=1e-12)


def test_default_axes():
    v, a = np.radians(60) * np.ones(4), np.radians(120) * np.ones(4)
    moves = np.radians([[0, 0, 0, 0], [0, 7.5, 0, -1], [30, 0, 0, 0], [90, 10, -180, 0]])
    np.testing.assert_allclose(move_time(moves, v, a), [0, 0.5, 1.0, 3.5])


@given(some, some, some, st.floats(0, 1))
def test_progress_keeps_within_speed_and_acceleration(d, v, a, where):
    delta, v, a = np.array([d, 0.3 * d]), np.array([v, v]), np.array([a, 2 * a])
    total = float(move_time(delta, v, a))
    h = 1e-4 * total
    t = where * total
    before, at, after = (progress(delta, v, a, t + k * h) for k in (-1, 0, 1))
    assert 0 <= before <= at <= after <= 1
    assert np.all(delta * (after - before) / (2 * h) <= v * (1 + 1e-6) + 1e-9)
    assert np.all(delta * abs(after - 2 * at + before) / h**2 <= a * (1 + 1e-3) + 1e-12 * d / h**2)
    assert progress(delta, v, a, 0) == 0 and progress(delta, v, a, total) == 1
    np.testing.assert_allclose(progress(delta, v, a, total / 2), 0.5, rtol=1e-9)
