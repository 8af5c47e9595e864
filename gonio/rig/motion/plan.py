"""Motion that wastes nothing: from pairs of directions to poses in the cheapest order.

Every saving is a switch of `PlanConfig`. What is planned is exact in all cases: the order of a batch is the rig's
own affair, equivalent poses show the same pair, and for an isotropic sample so do a turned table and the mirror image.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from gonio.config.plan import PlanConfig
from gonio.geometry import Array
from gonio.rig.motion.envelope import Envelope
from gonio.rig.motion.profile import move_time
from gonio.rig.motion.tour import FAR, Order, best_branches, nearest_neighbour, or_opt, time_matrix, two_opt


@dataclass(frozen=True)
class Tour:
    """Pairs in the order of their visit: which (M,), poses (M, A) in rad, seconds of travel to each (M,)."""

    which: Order
    poses: Array
    seconds: Array


class Planner:
    """Plans batches for one rig and one kind of sample."""

    def __init__(self, envelope: Envelope, plan: PlanConfig, isotropic: bool):
        self.envelope, self.plan = envelope, plan
        self.free = isotropic and plan.free_azimuth
        self.velocity = np.array([a.velocity for a in envelope.axes])
        self.acceleration = np.array([a.acceleration for a in envelope.axes])

    def tours(self, wi: Array, wo: Array, start: Array) -> Iterator[Tour]:
        """Tours that together visit every reachable pair (N, 3), (N, 3) once, the first from pose `start` (A,).

        Pairs that the rig cannot reach are left out. A tour is planned when it is asked for.
        """
        within = np.flatnonzero(self.envelope.reachable(wi, wo))
        for begin in range(0, len(within), self.plan.window):
            part = within[begin : begin + self.plan.window]
            tour = self._tour(wi[part], wo[part], start)
            if len(tour.which):
                start = tour.poses[-1]
                yield Tour(part[tour.which], tour.poses, tour.seconds)

    def candidates(self, wi: Array, wo: Array, near: Array) -> Array:
        """Every pose (N, B, A) that may show the pairs, FAR where it is not allowed."""
        kinematics = self.envelope.kinematics
        inverse = kinematics.inverse_isotropic if self.free else kinematics.inverse
        poses = inverse(wi, wo, near)
        if self.plan.reciprocity:
            poses = np.concatenate([poses, inverse(wo, wi, near)], 1)
        poses, allowed = self.envelope.fit(poses)
        if allowed.all():
            return poses if self.plan.branches else poses[:, :1]
        if not self.plan.branches:  # the first that is allowed
            first = allowed.argmax(1)[:, None]
            poses = np.take_along_axis(poses, first[:, :, None], 1)
            allowed = np.take_along_axis(allowed, first, 1)
        poses[~allowed] = FAR
        return poses

    def _tour(self, wi: Array, wo: Array, start: Array) -> Tour:
        poses = self.candidates(wi, wo, start)
        if len(poses) == 1:  # the one chain's case, in as few steps as can be
            seconds = move_time(poses[0] - start, self.velocity, self.acceleration)
            best = seconds.argmin()
            which = np.zeros(int(poses[0, best, 0] < FAR), int)
            return Tour(which, poses[which, best], seconds[which + best])
        which = np.flatnonzero((poses[:, :, 0] < FAR).any(1))
        poses = poses[which]
        if self.plan.tour and len(which) > 1:
            order = self._order(poses, start)
            which, poses = which[order], poses[order]
        if poses.shape[1] > 1 and len(which):
            branch = best_branches(start, poses, self.velocity, self.acceleration)
            poses = poses[np.arange(len(which)), branch]
        else:
            poses = poses[:, 0]
        before = np.concatenate([start[None], poses[:-1]])
        return Tour(which, poses, move_time(poses - before, self.velocity, self.acceleration))

    def _order(self, poses: Array, start: Array) -> Order:
        order, branch = nearest_neighbour(start, poses, self.velocity)
        chosen = poses[order, branch]
        cost = time_matrix(np.concatenate([start[None], chosen]), self.velocity, self.acceleration)
        path = np.arange(len(cost))
        path = or_opt(cost, two_opt(cost, path))
        return order[path[1:] - 1]
