"""Directions, the half/difference frame of Rusinkiewicz (1998), and the Jacobian between the two.

Everything is float64 and vectorised over a leading axis: directions are (N, 3) unit vectors with z along the
sample's normal, angles are (N,) radians. `wi` points to the light, `wo` to the detector.

    h = normalize(wi + wo),   d = R_y(-theta_h) R_z(-phi_h) wi

No `acos` and no `1 - cos**2`: both lose half the digits near a pole, where a glossy sample keeps its peak.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

# float64 wherever this project makes one; shapes are said in words, which the type cannot
Array = NDArray[Any]


def unit(v: Array) -> Array:
    """v / |v| along the last axis; the z axis where v = 0."""
    v = np.asarray(v, np.float64)
    # two steps, so that neither 1e-300 nor 1e300 is squared as it stands
    scale = np.max(np.abs(v), axis=-1, keepdims=True)
    w = v / np.where(scale > 0, scale, 1)
    w = w / np.where(scale > 0, np.linalg.norm(w, axis=-1, keepdims=True), 1)
    return np.where(scale > 0, w, np.array([0.0, 0.0, 1.0]))


def directions(w: Array) -> Array:
    """(N, 3) float64. Of float32 the unit vectors nearest: they are 1e-7 off in length, which near the mirror
    direction, where the difference of the two is small, would be half of theta_h."""
    w = np.atleast_2d(np.asarray(w))
    return w if w.dtype == np.float64 else unit(w)


def from_angles(theta: Array | float, phi: Array | float) -> Array:
    """Unit vectors (N, 3) of elevation theta (from the normal) and azimuth phi."""
    theta, phi = np.broadcast_arrays(np.asarray(theta, float), np.asarray(phi, float))
    s = np.sin(theta)
    return np.stack([s * np.cos(phi), s * np.sin(phi), np.cos(theta)], -1)


def from_height(z: Array, phi: Array) -> Array:
    """Unit vectors (N, 3) of height z along the normal, in [-1, 1], and azimuth phi: z even is even in solid angle."""
    s = np.sqrt((1 - z) * (1 + z))
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], -1)


def to_angles(w: Array) -> tuple[Array, Array]:
    """(theta, phi) of unit vectors; phi in (-pi, pi], 0 at the poles."""
    w = np.asarray(w, float)
    return np.arctan2(np.hypot(w[..., 0], w[..., 1]), w[..., 2]), np.arctan2(w[..., 1], w[..., 0])


def to_half_diff(wi: Array, wo: Array) -> tuple[Array, Array, Array, Array]:
    """(theta_h, phi_h, theta_d, phi_d) of a pair of directions; phi_h and phi_d in (-pi, pi].

    Built from s = wi + wo and t = wi - wo, orthogonal for exact unit vectors. The rounding that spoils it is put
    into the shorter of the two, where it is an absolute error of 1e-16, so that pairs with wi near wo (theta_d = 0)
    and wi near -wo (theta_d = pi/2) survive the round trip to the last digits.
    """
    wi, wo = directions(wi), directions(wo)
    s, t = wi + wo, wi - wo
    ss, tt, st = _dot(s, s), _dot(t, t), _dot(s, t)
    short_s = (ss < tt)[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        s, t = np.where(short_s, s - (st / tt)[..., None] * t, s), np.where(short_s, t, t - (st / ss)[..., None] * s)
    theta_d = np.arctan2(np.linalg.norm(t, axis=-1), np.linalg.norm(s, axis=-1))
    opposite = ss == 0  # every h at a right angle to t is a half vector then: take the one nearest the normal
    if np.any(opposite):
        s = np.where(opposite[..., None], _upright(t), s)
    theta_h, phi_h = to_angles(s)
    x, y, _ = _into_frame(t, theta_h, phi_h)
    return theta_h, phi_h, theta_d, np.arctan2(y, x)


def from_half_diff(theta_h: Array, phi_h: Array, theta_d: Array, phi_d: Array) -> tuple[Array, Array]:
    """(wi, wo) of half/difference angles, the inverse of `to_half_diff`. Either may lie below the horizon."""
    theta_h, phi_h, theta_d, phi_d = np.broadcast_arrays(
        *(np.asarray(a, float) for a in (theta_h, phi_h, theta_d, phi_d))
    )
    h = from_angles(theta_h, phi_h)
    sd, cd = np.sin(theta_d)[..., None], np.cos(theta_d)[..., None]
    ch, sh, cp, sp = np.cos(theta_h), np.sin(theta_h), np.cos(phi_h), np.sin(phi_h)
    x = np.stack([ch * cp, ch * sp, -sh], -1)
    y = np.stack([-sp, cp, np.zeros_like(cp)], -1)
    t = np.cos(phi_d)[..., None] * x + np.sin(phi_d)[..., None] * y
    return cd * h + sd * t, cd * h - sd * t


def half_vector(wi: Array, wo: Array) -> Array:
    """normalize(wi + wo), (N, 3)."""
    s = directions(wi) + directions(wo)
    length = np.sqrt(_dot(s, s))[..., None]
    if np.all(length > 1e-150):
        return s / length
    return unit(s)  # opposite directions: no half vector, the z axis stands in


def cos_theta_d(wi: Array, wo: Array) -> Array:
    """wi.h = wo.h = |wi + wo| / 2, (N,): the dot product loses its digits where both lie near the horizon, opposite."""
    s = directions(wi) + directions(wo)
    return 0.5 * np.sqrt(_dot(s, s))


def reflect(w: Array, h: Array) -> Array:
    """w mirrored about h: 2 (w.h) h - w."""
    return 2 * _dot(w, h)[..., None] * h - w


def half_diff_jacobian(theta_d: Array) -> Array:
    """|d(wi, wo) / d(h, d)| = 4 cos theta_d, solid angles on both sides.

    With the angles' own measure, dwi dwo = 4 cos(theta_d) sin(theta_h) sin(theta_d) dtheta_h dphi_h dtheta_d dphi_d.
    """
    return 4 * np.cos(theta_d)


def above_horizon(wi: Array, wo: Array) -> NDArray[np.bool_]:
    """Where both directions lie strictly above the surface."""
    return (np.asarray(wi)[..., 2] > 0) & (np.asarray(wo)[..., 2] > 0)


def _upright(t: Array) -> Array:
    """A vector at a right angle to t, as near to z as can be (to x where t is along z)."""
    along_z = np.hypot(t[..., 0], t[..., 1]) < 1e-8 * np.abs(t[..., 2])
    axis = np.where(along_z[..., None], np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]))
    with np.errstate(divide="ignore", invalid="ignore"):
        return axis - (_dot(axis, t) / _dot(t, t))[..., None] * t


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...i,...i->...", a, b)


def _into_frame(v: Array, theta: Array, phi: Array) -> tuple[Array, Array, Array]:
    """Components of v after R_y(-theta) R_z(-phi)."""
    ct, st, cp, sp = np.cos(theta), np.sin(theta), np.cos(phi), np.sin(phi)
    x, y, z = cp * v[..., 0] + sp * v[..., 1], cp * v[..., 1] - sp * v[..., 0], v[..., 2]
    return ct * x - st * z, y, st * x + ct * z
