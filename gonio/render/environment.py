"""Two environment maps of our own making, equirectangular linear RGB (H, W, 3)."""

import numpy as np

from gonio.geometry import Array, from_angles

# towards the lamp, angular radius in degrees, radiance
LAMPS = (
    ((0.5, 0.7, 0.5), 3, 120),
    ((-0.7, 0.6, 0.4), 4, 60),
    ((0.1, 0.95, -0.3), 6, 25),
    ((0.9, 0.2, -0.4), 3, 80),
    ((-0.3, 0.4, 0.86), 2.5, 120),
)


def _directions(height: int) -> Array:
    """Unit vectors of the pixels, y up: the layout of Mitsuba's `envmap`."""
    v, u = np.meshgrid((np.arange(height) + 0.5) / height, (np.arange(2 * height) + 0.5) / (2 * height), indexing="ij")
    w = from_angles(np.pi * v.ravel(), 2 * np.pi * u.ravel())
    return np.stack([w[:, 0], w[:, 2], w[:, 1]], -1).reshape(height, 2 * height, 3)


def smooth_sky(height: int = 256) -> Array:
    """A pale zenith over a blue horizon, a brown ground, a broad warm glow."""
    w = _directions(height)
    up = w[..., 1:2]
    t = 0.5 * (1 + np.tanh(5 * up))
    sky = np.array([0.45, 0.65, 0.95]) * (0.5 + 0.6 * np.clip(up, 0, 1))
    glow = np.exp(6 * (w @ np.array([0.6, 0.5, 0.62]) - 1))[..., None] * np.array([1.6, 1.2, 0.8])
    return t * sky + (1 - t) * np.array([0.16, 0.13, 0.1]) + glow


def small_lights(height: int = 256) -> Array:
    """A dim room with five small bright lamps."""
    w = _directions(height)
    image = np.full(w.shape, 0.05) + 0.1 * np.clip(w[..., 1:2], 0, 1)
    for axis, radius, power in LAMPS:
        a = np.asarray(axis) / np.linalg.norm(axis)
        image = image + (w @ a > np.cos(np.radians(radius)))[..., None] * power * np.array([1.0, 0.95, 0.9])
    return image


ENVIRONMENTS = {"sky": smooth_sky, "lights": small_lights}
