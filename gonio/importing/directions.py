"""Angles, in the conventions that files use, -> pairs of unit vectors (wi to the light, wo to the detector)."""

import numpy as np

from gonio.geometry import Array, from_angles, from_half_diff, unit


def spherical(theta_i: Array, phi_i: Array, theta_o: Array, phi_o: Array) -> tuple[Array, Array]:
    """Radians, each azimuth that of the direction itself: the mirror direction is at phi_i + pi.

    A theta below 0 is the direction on the other side of the normal, as in-plane scans write it.
    """
    return from_angles(theta_i, phi_i), from_angles(theta_o, phi_o)


def relative(theta_i: Array, phi: Array, theta_o: Array, specular_deg: float) -> tuple[Array, Array]:
    """phi: azimuth of the detector against the light's plane, `specular_deg` (0 or 180) in the mirror direction."""
    return spherical(theta_i, np.zeros_like(theta_i), theta_o, phi + np.pi - np.radians(specular_deg))


def half_difference(theta_h: Array, phi_h: Array, theta_d: Array, phi_d: Array) -> tuple[Array, Array]:
    """Rusinkiewicz 1998, as `gonio.geometry`."""
    return from_half_diff(theta_h, phi_h, theta_d, phi_d)


def vectors(wi: Array, wo: Array) -> tuple[Array, Array]:
    """Made unit; NaN where a vector has no length."""
    return _unit(wi), _unit(wo)


def _unit(w: Array) -> Array:
    length = np.linalg.norm(w, axis=1, keepdims=True)
    return np.where(length > 0, unit(w), np.nan)


def about_mirror(theta_i: Array, radial: Array, azimuth: Array) -> tuple[Array, Array]:
    """Directions counted from the mirror direction: `radial` away from it, azimuth 0 towards the normal (radians).

    The light is at azimuth 0, so that the mirror direction is (-sin theta_i, 0, cos theta_i).
    """
    w = from_angles(radial, azimuth)
    c, s = np.cos(theta_i), np.sin(theta_i)
    wo = np.stack([w[..., 0] * c - w[..., 2] * s, w[..., 1], w[..., 0] * s + w[..., 2] * c], -1)
    return from_angles(theta_i, np.zeros_like(theta_i)), wo


def turned(w: Array, phi: Array | float) -> Array:
    """w turned about the normal by phi (radians)."""
    c, s = np.cos(phi), np.sin(phi)
    return np.stack([c * w[..., 0] - s * w[..., 1], s * w[..., 0] + c * w[..., 1], w[..., 2]], -1)
