"""Ways from pose to pose that keep out of the stay-out cone: straight where clear, else by one or two waypoints.

The waypoints combine, joint by joint, the angles of either end with some well inside the range. On the gantry one of
them is always to be had: with the detector arm low and at right angles to the light arm's plane, the light arm is free.
"""

from collections.abc import Callable

import numpy as np

from gonio.geometry import Array
from gonio.rig.motion.envelope import TOLERANCE, Envelope

Seconds = Callable[[Array], Array]  # of joint distances (..., A)
INNER = np.array([0.07, 0.25, 0.75, 0.93])  # of an axis's range
CHUNK, MAX_PAIRS = 32, 1024  # waypoints looked at in one go, pairs of waypoints before a way is given up


def route(envelope: Envelope, a: Array, b: Array, seconds: Seconds) -> Array | None:
    """Poses (K, A) to go through from a to b (both (A,)), b last; K = 1 if the straight way is clear. None: no way.

    Of the ways by one waypoint the fastest is taken, and of those by two if there is none by one.
    """
    if envelope.path_clear(a[None], b[None])[0]:
        return b[None]
    via = _waypoints(envelope, a, b)
    if envelope.separation(a) < envelope.stay_out + TOLERANCE:
        return _out_of_the_cone(envelope, a, b, via, seconds)
    via = via[np.argsort(seconds(via - a) + seconds(b - via), kind="stable")]
    first, last = [], []
    for k in range(0, len(via), CHUNK):
        some = via[k : k + CHUNK]
        there = envelope.path_clear(np.broadcast_to(a, some.shape), some)
        back = envelope.path_clear(some, np.broadcast_to(b, some.shape))
        if (both := there & back).any():
            return np.stack([some[int(both.argmax())], b])
        first.append(some[there])
        last.append(some[back])
    return _by_two(envelope, a, b, np.concatenate(first), np.concatenate(last), seconds) if first else None


def _by_two(envelope: Envelope, a: Array, b: Array, first: Array, last: Array, seconds: Seconds) -> Array | None:
    time = seconds(first - a)[:, None] + seconds(last[None] - first[:, None]) + seconds(b - last)
    order = np.argsort(time, axis=None, kind="stable")[:MAX_PAIRS]
    for k in range(0, len(order), CHUNK):
        i, j = np.unravel_index(order[k : k + CHUNK], time.shape)
        clear = envelope.path_clear(first[i], last[j])
        if clear.any():
            best = int(clear.argmax())
            return np.stack([first[i[best]], last[j[best]], b])
    return None


def _out_of_the_cone(envelope: Envelope, a: Array, b: Array, via: Array, seconds: Seconds) -> Array | None:
    """As `route`, for a rig that stopped short inside the cone: first away from it, never deeper into it."""
    here = envelope.separation(a) - 1e-9
    share = np.linspace(0, 1, 65)[1:, None]
    for way in via[np.argsort(seconds(via - a), kind="stable")]:
        if envelope.separation(a + share * (way - a)).min() >= here:
            rest = route(envelope, way, b, seconds)
            if rest is not None:
                return np.concatenate([way[None], rest])
    return None


def _waypoints(envelope: Envelope, a: Array, b: Array) -> Array:
    """Poses (V, A), inside the limits and clear of the cone."""
    inner = envelope.snap(envelope.lower + INNER[:, None] * (envelope.upper - envelope.lower))
    arms = envelope.kinematics.arms
    values = [[b[k], a[k], *inner[:, k]] if arms[k] else [b[k]] for k in range(len(arms))]
    via = np.stack(np.meshgrid(*values, indexing="ij"), -1).reshape(-1, len(values))
    return via[envelope.inside(via) & (envelope.separation(via) >= envelope.stay_out + 2 * TOLERANCE)]
