"""Frames of several exposures -> one linear picture, by inverse variance.

    e = sum w t (s - d) / sum w t^2,    w = 1 / (read^2 + k e0 t),    sigma^2 = 1 / sum w t^2

s counts of one exposure t, d its dark frame, k counts per electron; e counts per second. e0 is the same with the
weights of read noise alone: weights made of the very counts that they weigh would favour those that fell low. w = 0
where s is near saturation, and where e0 t drowns in the dark as long as a longer exposure does not. OpenCV's own merges
are not linear.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array

NEAR_SATURATION = 0.95
NEAR_DARK = 3.0  # read noises


@dataclass(frozen=True)
class Picture:
    """Linear radiance in counts per second and its sigma, (H, W, P); saturated (H, W) in every exposure."""

    value: Array
    sigma: Array
    saturated: NDArray[np.bool_]


def merge(
    frames: list[NDArray], exposures: list[float], darks: list[Array], full: float, read: float, k: float
) -> Picture:
    """frames, darks (H, W, P) of each exposure in seconds; full = largest count; read noise in counts."""
    s = np.stack([np.atleast_3d(f) for f in frames]).astype(float)
    light = s - np.stack([np.atleast_3d(d) for d in darks])
    t = np.asarray(exposures, float)[:, None, None, None]
    good = s < NEAR_SATURATION * full
    first, _ = _weighted(good / read**2, t, light)
    level = np.maximum(np.nan_to_num(first), 0) * t
    longest = np.where(good, t, 0).max(0)
    w = np.where(good & ((level > NEAR_DARK * read) | (t == longest)), 1 / (read**2 + k * level), 0.0)
    value, weight = _weighted(w, t, light)
    # where all are near saturation, the shortest says at least how bright it is
    n = int(np.argmin(exposures))
    noise = np.sqrt(read**2 + k * np.maximum(light[n], 0))
    value = np.where(weight > 0, value, light[n] / exposures[n])
    sigma = np.where(weight > 0, 1 / np.sqrt(np.maximum(weight, 1e-300)), noise / exposures[n])
    return Picture(value, sigma, np.asarray(~good.any(0).all(-1)))


def _weighted(w: Array, t: Array, light: Array) -> tuple[Array, Array]:
    """Counts per second by weights w, and the weight of all; NaN where no exposure counts."""
    weight = (w * t * t).sum(0)
    with np.errstate(invalid="ignore"):
        return (w * t * light).sum(0) / np.where(weight > 0, weight, np.nan), weight


def bad_pixels(dark: Array, flat: Array | None, read: float) -> NDArray[np.bool_]:
    """(H, W): much brighter than their dark neighbours, or answering to light by less than half or more than double."""
    from scipy.ndimage import median_filter

    dark = np.atleast_3d(dark)
    local = np.stack([median_filter(dark[..., c], 5) for c in range(dark.shape[-1])], -1)
    bad = (np.abs(dark - local) > 8 * read).any(-1)
    if flat is not None:
        flat = np.atleast_3d(flat)
        smooth = np.stack([median_filter(flat[..., c], 5) for c in range(flat.shape[-1])], -1)
        ratio = flat / np.maximum(smooth, 1e-12)
        bad |= ((ratio < 0.5) | (ratio > 2)).any(-1)
    return bad


def in_the_middle(flat: Array, good: NDArray[np.bool_]) -> Array:
    """(P,): what a flat picture (H, W, P) is in its middle, by a smooth surface through all good (H, W) pixels."""
    height, width = good.shape
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    every = max(int(np.sqrt(good.size / 1e5)), 1)  # a hundred thousand pixels will do
    used = np.zeros_like(good)
    used[::every, ::every] = good[::every, ::every]
    x, y = x[used], y[used]
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y, x**4, x * x * y * y, y**4], -1)
    fit, *_ = np.linalg.lstsq(terms, flat[used], rcond=None)
    return np.asarray(fit[0])
