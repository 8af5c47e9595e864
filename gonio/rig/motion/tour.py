"""The order in which to visit a batch of targets, each of which can be met in any of several poses.

Travel time stands for distance. A tour is built by nearest neighbour over targets and poses together, shortened by
2-opt and Or-opt at fixed poses, and then given its best poses by dynamic programming at fixed order. Nothing here
depends on the clock of the machine: the same input gives the same tour.
"""

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.rig.motion.profile import move_time

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
    edge = cost[t[:-1], t[1:]]
    for _ in range(sweeps):
        improved = False
        for i in range(1, n - 1):
            # reverse t[i..j]: edges (a, b) and (t[j], t[j+1]) become (a, t[j]) and (b, t[j+1])
            later = t[i + 1 :]
            change = cost[t[i - 1]].take(later)
            change[:-1] += cost[t[i]].take(later[1:])
            change[:-1] -= edge[i + 1 :]
            j = int(change.argmin())
            if change[j] < edge[i - 1] - 1e-9:
                end = i + j + 2
                t[i:end] = t[i:end][::-1].copy()
                edge[i : end - 1] = edge[i : end - 1][::-1].copy()
                edge[i - 1] = cost[t[i - 1], t[i]]
                if end < n:
                    edge[end - 1] = cost[t[end - 1], t[end]]
                improved = True
        if not improved:
            break
    return t


def or_opt(cost: Array, order: Order, longest: int = 3) -> Order:
    """`order` shortened by moving stretches of up to `longest` elsewhere, either way round; order[0] stays first."""
    t = order.copy()
    n = len(t)
    edge = np.append(cost[t[:-1], t[1:]], 0.0)  # after the last one comes nothing
    for length in range(1, longest + 1):
        for i in range(1, n - length + 1):
            j = i + length - 1
            to_first, to_last = cost[t[i]].take(t), cost[t[j]].take(t)
            saved = edge[i - 1] + edge[j] - (cost[t[i - 1], t[j + 1]] if j + 1 < n else 0.0)
            # between t[k] and t[k+1]: first after t[k], or last after t[k]; nothing comes after the end
            into, flip = to_first - edge, to_last - edge
            into[:-1] += to_last[1:]
            flip[:-1] += to_first[1:]
            into[i - 1 : j + 1] = flip[i - 1 : j + 1] = np.inf
            k, m = int(into.argmin()), int(flip.argmin())
            turned = flip[m] < into[k]
            if (flip[m] if turned else into[k]) < saved - 1e-9:
                k = m if turned else k
                piece = t[i : j + 1][::-1] if turned else t[i : j + 1]
                if k < i:
                    t = np.concatenate([t[: k + 1], piece, t[k + 1 : i], t[j + 1 :]])
                else:
                    t = np.concatenate([t[:i], t[j + 1 : k + 1], piece, t[k + 1 :]])
                edge[:-1] = cost[t[:-1], t[1:]]
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
