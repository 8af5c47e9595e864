"""Any rig of revolute joints: forward by products of rotations, inverse by iteration.

    wi = unit(S^T (L l0 + cl) - h z),   wo = unit(S^T (D d0 + cd) - h z)

with S, L, D the rotations of the sample, the light and the detector, each a product of turns about axes fixed in the
frame of the joint before (Rodrigues); cl, cd how far the centres about which the arms turn lie beside the sample's
axes, h the sample's height above them along its normal z, all in arm lengths: 0 where all axes meet in the sample. The
inverse starts from the closed form most like the rig and refines it by damped least squares (Levenberg 1944), where the
damping fades with the residual; it is how a calibrated rig, whose axes are a little tilted, is driven.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array, unit
from gonio.rig.kinematics.base import Kinematics

GOOD = 1e-8  # residual in rad at which a pose counts as solved
ITERATIONS = 30


@dataclass(frozen=True)
class Joint:
    """A turn of the axis `name` about `axis` (3,), unit, in the frame of the joint before."""

    name: str
    axis: Array


class Chain:
    """Joints from the base outwards for each part; `names` is the order of a pose.

    light_rest, detector_rest (3,) and frame (3, 3), the sample's x, y, z axes as columns: in the lab, all joints at 0.
    centres (2, 3), of the light's arm and of the detector's, in the lab, and height: see above.
    """

    def __init__(
        self,
        light: Sequence[Joint],
        detector: Sequence[Joint],
        sample: Sequence[Joint],
        nearest: Kinematics,
        light_rest: Array,
        detector_rest: Array,
        frame: Array,
        names: tuple[str, ...],
        centres: Array | None = None,
        height: float = 0.0,
    ):
        self.names = names
        column = {name: k for k, name in enumerate(names)}
        self._light, self._detector, self._sample = (
            [(column[j.name], unit(j.axis)) for j in part] for part in (light, detector, sample)
        )
        self.arms = np.array([any(k == c for c, _ in self._light + self._detector) for k in range(len(self.names))])
        self.nearest = nearest
        self._from_nearest = [(column[n], k) for k, n in enumerate(nearest.names) if n in column]
        self._rest = unit(light_rest), unit(detector_rest)
        self._frame = frame
        self._centres, self._height = np.zeros((2, 3)) if centres is None else np.asarray(centres, float), height

    def forward(self, pose: Array) -> tuple[Array, Array]:
        pose = np.asarray(pose, float)
        flat = pose.reshape(-1, pose.shape[-1])
        wi, wo, _ = self._solve_forward(flat)
        return wi.reshape(*pose.shape[:-1], 3), wo.reshape(*pose.shape[:-1], 3)

    @property
    def axes(self) -> dict[str, Array]:
        """The axis of each joint by its name, (3,) in the frame of the joint before."""
        return {self.names[c]: axis for c, axis in (*self._light, *self._detector, *self._sample)}

    @property
    def detector_rest(self) -> Array:
        """Where the detector is with every joint at 0, (3,) in the lab."""
        return np.asarray(self._rest[1])

    def arm(self, pose: Array) -> Array:
        """Rotation (3, 3) from the sample's frame into that of the detector arm, which is the lab's at rest."""
        seen, _ = _rotation(self._detector, np.asarray(pose, float)[None])
        sample, _ = _rotation(self._sample, np.asarray(pose, float)[None])
        return np.asarray(seen[0].T @ sample[0] @ self._frame)

    def inverse(self, wi: Array, wo: Array, near: Array) -> Array:
        near_closed = self._closed(near)
        return self._refine(self.nearest.inverse(wi, wo, near_closed), wi, wo, near)

    def inverse_isotropic(self, wi: Array, wo: Array, near: Array) -> Array:
        poses = self.nearest.inverse_isotropic(wi, wo, self._closed(near))
        turned_i, turned_o = self.nearest.forward(poses)
        return self._refine(poses, turned_i, turned_o, near)

    def _closed(self, near: Array) -> Array:
        pose = np.zeros(len(self.nearest.names))
        for here, there in self._from_nearest:
            pose[there] = near[here]
        return pose

    def _refine(self, start: Array, wi: Array, wo: Array, near: Array) -> Array:
        """Poses (N, B, A) in this rig's axes that show wi, wo ((N, 3) or (N, B, 3)) from those of the closed form."""
        n, b, _ = start.shape
        q = np.broadcast_to(near, (n, b, len(self.names))).copy()
        for here, there in self._from_nearest:
            q[:, :, here] = start[:, :, there]
        q = q.reshape(n * b, len(self.names))
        each = lambda w: np.broadcast_to(w if w.ndim == 3 else w[:, None], (n, b, 3)).reshape(-1, 3)
        goal = np.concatenate([each(wi), each(wo)], 1)
        going = np.arange(n * b)
        bad = np.zeros(n * b)
        for _ in range(ITERATIONS):
            wi_q, wo_q, jacobian = self._solve_forward(q[going], jacobian=True)
            residual = goal[going] - np.concatenate([wi_q, wo_q], 1)
            size = np.linalg.norm(residual, axis=1)
            bad[going] = size
            unsolved = size > 1e-14
            going, residual, jacobian, size = (a[unsolved] for a in (going, residual, jacobian, size))
            if not len(going):
                break
            normal = np.einsum("nij,nik->njk", jacobian, jacobian)
            # free joints (poles, redundant chains) stay put; the floor keeps the matrix regular there
            normal += (1e-3 * size**2 + 1e-12)[:, None, None] * np.eye(q.shape[1])
            q[going] += np.linalg.solve(normal, np.einsum("nij,ni->nj", jacobian, residual)[..., None])[..., 0]
        q[bad > GOOD] = np.nan
        q -= 2 * np.pi * np.rint(q / (2 * np.pi))
        return q.reshape(n, b, len(self.names))

    def _solve_forward(self, q: Array, jacobian: bool = False):
        """wi, wo (N, 3) and, if asked for, d(wi, wo)/dq (N, 6, A)."""
        light, light_axes = _carry(self._light, q, self._rest[0])
        seen, seen_axes = _carry(self._detector, q, self._rest[1])
        sample, sample_axes = _rotation(self._sample, q)
        frame = sample @ self._frame
        into = lambda v: np.einsum("nij,ni->nj", frame, v)
        up = np.array([0, 0, self._height])
        to_light, to_detector = into(light + self._centres[0]) - up, into(seen + self._centres[1]) - up
        wi, wo = unit(to_light), unit(to_detector)
        if not jacobian:
            return wi, wo, None
        j = np.zeros((len(q), 6, q.shape[1]))
        for rows, arm, centre, axes, far, w in (
            (slice(0, 3), light, self._centres[0], light_axes, to_light, wi),
            (slice(3, 6), seen, self._centres[1], seen_axes, to_detector, wo),
        ):
            for k, axis in axes:
                j[:, rows, k] += into(np.cross(axis, arm))
            for k, axis in sample_axes:
                j[:, rows, k] -= into(np.cross(axis, arm + centre))
            part = j[:, rows]  # of what changes, only what lies across w turns it
            part -= w[:, :, None] * np.einsum("ni,nik->nk", w, part)[:, None]
            part /= np.linalg.norm(far, axis=1)[:, None, None]
        return wi, wo, j


def _rotation(joints: list[tuple[int, Array]], q: Array) -> tuple[Array, list[tuple[int, Array]]]:
    """Product of the joints' rotations (N, 3, 3), and each joint's axis (N, 3) in the lab."""
    total = np.broadcast_to(np.eye(3), (len(q), 3, 3))
    axes = []
    for k, axis in joints:
        axes.append((k, total @ axis))
        total = total @ _turn(axis, q[:, k])
    return total, axes


def _carry(joints: list[tuple[int, Array]], q: Array, rest: Array) -> tuple[Array, list[tuple[int, Array]]]:
    """Where the joints take the direction `rest` (3,): (N, 3); and their axes in the lab."""
    total, axes = _rotation(joints, q)
    return total @ rest, axes


def _turn(axis: Array, angle: Array) -> Array:
    """Rotation (N, 3, 3) about a unit axis (Rodrigues)."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, half = np.sin(angle)[:, None, None], np.sin(angle / 2)[:, None, None]
    return np.eye(3) + s * cross + 2 * half**2 * (cross @ cross)
