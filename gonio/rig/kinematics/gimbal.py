"""The gimbal and swing-arm rig in closed form: the light is fixed, the sample turns in a gimbal, the detector swings.

Lab frame: light along x, swing axis z. The normal is (cos tilt cos yaw, cos tilt sin yaw, sin tilt), `roll` turns the
sample about it, the detector looks from (cos d, sin d, 0). Hence
cos theta_i = cos tilt cos yaw, cos theta_o = cos tilt cos(d - yaw), and the angle between the arms is |d|.
"""

import numpy as np

from gonio.geometry import Array, unit


class Gimbal:
    """Axes yaw, tilt, roll, detector. At wi = wo, where a turn about the light is free, the frame of `near` stays."""

    names = ("yaw", "tilt", "roll", "detector")
    arms = np.array([False, False, False, True])

    def forward(self, pose: Array) -> tuple[Array, Array]:
        yaw, tilt, roll, detector = np.moveaxis(np.asarray(pose, float), -1, 0)
        light = np.stack([np.ones_like(yaw), np.zeros_like(yaw), np.zeros_like(yaw)], -1)
        seen = np.stack([np.cos(detector), np.sin(detector), np.zeros_like(yaw)], -1)
        return _to_sample(light, yaw, tilt, roll), _to_sample(seen, yaw, tilt, roll)

    def inverse(self, wi: Array, wo: Array, near: Array) -> Array:
        """Four branches: detector to either side, normal met with tilt or with pi - tilt."""
        wi, wo = np.asarray(wi, float), np.asarray(wo, float)
        across = np.cross(wi, wo)
        sine = np.linalg.norm(across, axis=-1)
        angle = np.arctan2(sine, (wi * wo).sum(-1))
        side = wo - np.cos(angle)[:, None] * wi
        same = sine < 1e-9
        if same.any():
            y = _to_sample(np.array([[0.0, 1.0, 0.0]]), *near[:3, None])
            side = np.where(same[:, None], y - (y * wi).sum(-1, keepdims=True) * wi, side)
        side = unit(side)
        branches = []
        for sign in (1.0, -1.0):
            y = sign * side
            up = np.cross(wi, y)
            # rows wi, y, up take the sample's axes to the lab's
            n = np.stack([wi[:, 2], y[:, 2], up[:, 2]], -1)
            x = np.stack([wi[:, 0], y[:, 0], up[:, 0]], -1)
            for flip in (False, True):
                yaw = np.arctan2(n[:, 1], n[:, 0])
                tilt = np.arctan2(n[:, 2], np.hypot(n[:, 0], n[:, 1]))
                if flip:
                    yaw, tilt = yaw - np.pi * np.where(yaw > 0, 1, -1), np.pi - tilt
                branches.append(np.stack([yaw, _wrapped(tilt), _roll(x, yaw, tilt), sign * angle], -1))
        return np.stack(branches, 1)

    def inverse_isotropic(self, wi: Array, wo: Array, near: Array) -> Array:
        mirror = np.array([1.0, -1.0, 1.0])
        poses = np.concatenate([self.inverse(wi, wo, near), self.inverse(wi * mirror, wo * mirror, near)], 1)
        poses[:, :, 2] = near[2]
        return poses


def _to_sample(v: Array, yaw: Array, tilt: Array, roll: Array) -> Array:
    """Lab vectors (..., 3) in the sample's frame, whose x, y, z are the lab's y, z, x at rest."""
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    x, y = np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x
    x, z = np.cos(tilt) * x + np.sin(tilt) * z, np.cos(tilt) * z - np.sin(tilt) * x
    return np.stack([np.cos(roll) * y + np.sin(roll) * z, np.cos(roll) * z - np.sin(roll) * y, x], -1)


def _roll(x: Array, yaw: Array, tilt: Array) -> Array:
    """Roll at which the sample's x axis points along x (N, 3) in the lab."""
    seen = _to_sample(x, yaw, tilt, np.zeros_like(yaw))
    return np.arctan2(seen[:, 1], seen[:, 0])


def _wrapped(angle: Array) -> Array:
    return angle - 2 * np.pi * np.rint(angle / (2 * np.pi))
