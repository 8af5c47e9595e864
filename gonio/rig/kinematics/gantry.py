"""A light arm over a turntable, a detector arm on an azimuth of its own: `Gantry`."""

import numpy as np

from gonio.geometry import Array

POLE = 1e-12  # sin(theta) below which an azimuth is rounding noise


class Gantry:
    """Light arm over a turntable, detector arm on an azimuth of its own; both arms are signed.

    theta_i = |light|, phi_i = -turntable (+ pi if light < 0); theta_o = |detector|, phi_o = azimuth - turntable
    (+ pi if detector < 0).
    """

    names = ("light", "turntable", "detector", "azimuth")
    arms = np.array([True, False, True, True])

    def forward(self, pose: Array) -> tuple[Array, Array]:
        pose = np.asarray(pose, float)
        theta = pose[..., 0::2]
        phi = pose[..., 1::2] * _MINUS_PLUS
        phi[..., 1] -= pose[..., 1]
        both = np.empty((*theta.shape, 3))  # light, detector
        sine = np.sin(theta)
        np.multiply(sine, np.cos(phi), out=both[..., 0])
        np.multiply(sine, np.sin(phi), out=both[..., 1])
        np.cos(theta, out=both[..., 2])
        return both[..., 0, :], both[..., 1, :]

    def inverse(self, wi: Array, wo: Array, near: Array) -> Array:
        theta_i, phi_i, pole_i = _polar(wi)
        theta_o, phi_o, pole_o = _polar(wo)
        table = _PI_L - phi_i
        if pole_i.any():
            table = np.where(pole_i, near[1], table)
        return _branches(theta_i, table, theta_o, phi_o + table + _PI_D, pole_o, near)

    def inverse_isotropic(self, wi: Array, wo: Array, near: Array) -> Array:
        theta_i, phi_i, pole_i = _polar(wi)
        theta_o, phi_o, pole_o = _polar(wo)
        phi = phi_o - phi_i
        poses = _branches(theta_i, near[1], theta_o, phi + _PI_LD, pole_i | pole_o, near)
        mirrored = poses.copy()
        mirrored[:, :, 3] *= -1
        return np.concatenate([poses, mirrored], 1)


# the four branches, as columns (4, 1): light arm +, +, -, -; detector arm +, -, +, -
_SIGN_L = np.array([[1.0], [1.0], [-1.0], [-1.0]])
_SIGN_D = np.array([[1.0], [-1.0], [1.0], [-1.0]])
_PI_L = np.pi * (_SIGN_L < 0)
_PI_D = np.pi * (_SIGN_D < 0)
_PI_LD = np.pi * (_SIGN_L != _SIGN_D)
_TURN = 2 * np.pi
_MINUS_PLUS = np.array([-1.0, 1.0])


def _branches(theta_i: Array, table, theta_o: Array, azimuth: Array, pole: np.ndarray, near: Array) -> Array:
    """Poses (N, 4, 4) from columns (4, N), angles brought to [-pi, pi]; at a pole the azimuth stays at `near`'s."""
    poses = np.empty((4, 4, len(theta_i)))  # axis, branch, pair
    np.multiply(_SIGN_L, theta_i, out=poses[0])
    poses[1] = table
    np.multiply(_SIGN_D, theta_o, out=poses[2])
    poses[3] = azimuth
    poses[1::2] -= _TURN * np.rint(poses[1::2] / _TURN)
    if pole.any():
        poses[3] = np.where(pole, near[3], poses[3])
    return poses.transpose(2, 1, 0)


def _polar(w: Array) -> tuple[Array, Array, np.ndarray]:
    """theta, phi (N,) and whether w is at the pole, where phi means nothing."""
    x, y, z = w[:, 0], w[:, 1], w[:, 2]
    rho = np.hypot(x, y)
    return np.arctan2(rho, z), np.arctan2(y, x), rho < POLE
