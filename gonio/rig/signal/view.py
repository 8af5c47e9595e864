"""What a camera on the detector arm sees of the sample: a point of the sample -> a pixel, at any pose of the rig.

    x_camera = R A(pose) x_sample + t,        pixel = K distort(x_camera / z_camera)

A turns the sample's frame into that of the arm (identity at the zero of every joint, up to the sample's rest), R and t
are the camera's mount on the arm, K and the distortion (Brown 1966: k1 k2 p1 p2 k3, as in OpenCV) its optics. Metres;
pixel (0, 0) is the middle of the first one; x right, y down, z away from the camera.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.rig.errors import DeviceFault

RIM = 32  # corners of the polygon that stands for a disk


@dataclass(frozen=True)
class View:
    """matrix (3, 3), distortion (5,), size (width, height), mount: rotation (3, 3), translation (3,).

    arm(pose) -> (3, 3) is A.
    """

    matrix: Array
    distortion: Array
    size: tuple[int, int]
    rotation: Array
    translation: Array
    arm: Callable[[Array], Array]

    def project(self, points: Array, pose: Array) -> Array:
        """Pixels (N, 2) of points (N, 3) of the sample; NaN behind the camera."""
        seen = points @ (self.rotation @ self.arm(pose)).T + self.translation
        z = np.where(seen[:, 2] > 0, seen[:, 2], np.nan)
        bent = distort(seen[:, :2] / z[:, None], self.distortion)
        return bent @ self.matrix[:2, :2].T + self.matrix[:2, 2]

    def disk(self, diameter: float, pose: Array) -> tuple[slice, slice, NDArray[np.bool_]]:
        """Rows, columns, and which pixels of that window show the disk (metres) round the sample's middle.

        Raises DeviceFault where the disk lies outside the picture.
        """
        angle = 2 * np.pi * np.arange(RIM) / RIM
        # the polygon has the disk's area
        radius = diameter / 2 * np.sqrt(2 * np.pi / RIM / np.sin(2 * np.pi / RIM))
        rim = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(RIM)], -1)
        corners = self.project(rim, pose)
        low, high = corners.min(0), corners.max(0)
        if not ((low > -0.5).all() and (high < np.array(self.size) - 0.5).all()):
            raise DeviceFault(
                "camera", "the patch lies outside its picture", "aim it again, then `gonio calibrate camera`"
            )
        first, last = np.ceil(low).astype(int), np.floor(high).astype(int)
        x, y = np.arange(first[0], last[0] + 1), np.arange(first[1], last[1] + 1)
        return slice(first[1], last[1] + 1), slice(first[0], last[0] + 1), _inside(x, y, corners)

    def on_sample(self, pose: Array) -> Array:
        """Where on the sample's plane each pixel looks, (height, width, 2) in metres; NaN past its horizon."""
        x, y = np.meshgrid(np.arange(self.size[0]), np.arange(self.size[1]))
        pixels = np.stack([x, y], -1).reshape(-1, 2)
        straight = undistort(np.linalg.solve(self.matrix[:2, :2], (pixels - self.matrix[:2, 2]).T).T, self.distortion)
        turn = (self.rotation @ self.arm(pose)).T
        ray = np.concatenate([straight, np.ones((len(straight), 1))], 1) @ turn.T
        eye = -turn @ self.translation
        along = -eye[2] / np.where(ray[:, 2] < 0, ray[:, 2], np.nan)
        return (eye + along[:, None] * ray)[:, :2].reshape(self.size[1], self.size[0], 2)


def distort(p: Array, d: Array) -> Array:
    """Points (N, 2) of the picture at distance 1, as the lens bends them."""
    k1, k2, p1, p2, k3 = (*d, 0, 0, 0, 0, 0)[:5]
    x, y = p[:, 0], p[:, 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    bent_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.stack([bent_x, bent_y], -1)


def undistort(p: Array, d: Array) -> Array:
    """The inverse of `distort`, by fixed-point iteration: for lenses that bend by some per cent."""
    q = p
    for _ in range(20 if np.any(d) else 0):
        q = q + (p - distort(q, d))
    return q


def rotation_of(vector: Array) -> Array:
    """Rotation (3, 3) about a vector (3,) by its length in rad (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = np.asarray(vector, float) / max(angle, 1e-300)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * cross + 2 * np.sin(angle / 2) ** 2 * (cross @ cross)


def facing(rest: Array) -> Array:
    """The mount (3, 3) of a camera out on the direction `rest` (3,) that looks back at the sample, x across."""
    z = -rest
    across = np.eye(3)[int(np.abs(rest).argmin())] if abs(rest[0]) > 0.9 else np.array([1.0, 0.0, 0.0])
    x = across - (across @ z) * z
    x = x / np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def _inside(x: NDArray[np.int64], y: NDArray[np.int64], corners: Array) -> NDArray[np.bool_]:
    """Which of the pixels (len(y), len(x)) lie in the convex polygon (N, 2)."""
    a, b = corners, np.roll(corners, -1, 0)
    turn = np.sign(((b - a)[:, 0] * np.roll(b - a, -1, 0)[:, 1] - (b - a)[:, 1] * np.roll(b - a, -1, 0)[:, 0]).sum())
    px, py = np.meshgrid(x, y)
    side = (b - a)[:, 0, None, None] * (py - a[:, 1, None, None]) - (b - a)[:, 1, None, None] * (
        px - a[:, 0, None, None]
    )
    return np.asarray((turn * side >= 0).all(0))
