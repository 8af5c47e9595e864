"""The order in which to visit a batch of targets, each of which can be met in any of several poses.

Travel time stands for distance. A tour is built by nearest neighbour over targets and poses together, shortened by
2-opt and Or-opt at fixed poses, and then given its best poses by dynamic programming at fixed order. Nothing here
depends on the clock of the machine: the same input gives the same tour.
"""

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.rig.motion import move_time

Order = NDArray[np.int64]
FAR = 1e9  # rad: stands for a pose that is not allowed


def nearest_neighbour(start: Array, poses: Array, velocity: Array) -> tuple[Order, Order]:
    """Order (N,) and branches (N,) of always going to the nearest of what is left; poses (N, B, A)."""
    n, b, a = poses.shape
    axes = [np.ascontiguousarray((poses[:, :, k] / velocity[k]).ravel()) for k in range(a)]
    left = np.arange(n)
    order, branch = np.empty(n, int), np.empty(n, int)
    here = list(start / velocity)
    for step in range(n):
        far = np.abs(axes[0] - here[0])
        for k in range(1, a):
            np.maximum(far, np.abs(axes[k] - here[k]), out=far)
        best = int(far.argmin())
        here = [x[best] for x in axes]
        order[step], branch[step] = left[best // b], best % b
        for x in axes:
            x[best - best % b : best - best % b + b] = FAR
        if step % 64 == 63:  # forget what has been visited
            rest = np.isin(left, order[: step + 1], invert=True)
            left, keep = left[rest], np.repeat(rest, b)
            axes = [x[keep] for x in axes]
    return order, branch


def time_matrix(poses: Array, velocity: Array, acceleration: Array) -> Array:
    """Seconds (N, N) between poses (N, A)."""
    return move_time(poses[:, None, :] - poses[None, :, :], velocity, acceleration)


def two_opt(cost: Array, order: Order, sweeps: int = 3) -> Order:
    """`order` shortened by reversing stretches; cost (N, N) symmetric. order[0] stays first, the end is open."""
    t = order.copy()
    n = len(t)
    for _ in range(sweeps):
        improved = False
        for i in range(1, n - 1):
            a, b = t[i - 1], t[i]
            # reverse t[i..j]: edges (a, b) and (t[j], t[j+1]) become (a, t[j]) and (b, t[j+1])
            ends, after = t[i + 1 :], t[i + 2 :]
            change = cost[a, ends] - cost[a, b]
            change[:-1] += cost[b, after] - cost[ends[:-1], after]
            j = int(change.argmin())
            if change[j] < -1e-9:
                t[i : i + j + 2] = t[i : i + j + 2][::-1].copy()
                improved = True
        if not improved:
            break
    return t


def or_opt(cost: Array, order: Order, longest: int = 3) -> Order:
    """`order` shortened by moving stretches of up to `longest` elsewhere, either way round; order[0] stays first."""
    t = order.copy()
    n = len(t)
    for length in range(1, longest + 1):
        i = 1
        while i + length <= n:
            piece = t[i : i + length]
            rest = np.concatenate([t[:i], t[i + length :]])
            first, last = piece[0], piece[-1]
            saved = cost[t[i - 1], first]
            if i + length < n:
                saved += cost[last, t[i + length]] - cost[t[i - 1], t[i + length]]
            before, after = rest[:-1], rest[1:]
            gap = cost[before, after]
            into = np.append(cost[before, first] + cost[last, after] - gap, cost[rest[-1], first])
            flip = np.append(cost[before, last] + cost[first, after] - gap, cost[rest[-1], last])
            k, m = int(into.argmin()), int(flip.argmin())
            turned = flip[m] < into[k]
            k, new = (m, flip[m]) if turned else (k, into[k])
            if new < saved - 1e-9:
                t = np.concatenate([rest[: k + 1], piece[::-1] if turned else piece, rest[k + 1 :]])
            i += 1
    return t


def best_branches(start: Array, poses: Array, velocity: Array, acceleration: Array) -> Order:
    """Branches (N,) of least total time for poses (N, B, A) visited in this order from `start` (Viterbi)."""
    n = len(poses)
    total = move_time(poses[0] - start, velocity, acceleration)
    steps = move_time(poses[1:, None, :, :] - poses[:-1, :, None, :], velocity, acceleration)  # (N-1, from, to)
    back = np.empty((n - 1, poses.shape[1]), int)
    columns = np.arange(poses.shape[1])
    for k in range(n - 1):
        through = total[:, None] + steps[k]
        back[k] = through.argmin(0)
        total = through[back[k], columns]
    branch = np.empty(n, int)
    branch[-1] = int(total.argmin())
    for k in range(n - 2, -1, -1):
        branch[k] = back[k][branch[k + 1]]
    return branch
