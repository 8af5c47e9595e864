"""Frames of several exposures -> one linear picture, by inverse variance.

    e = sum w t (s - d t) / sum w t^2,    w = 1 / (read^2 + k max(s - d t, 0)),    sigma^2 = 1 / sum w t^2

s counts of one exposure t, d t its dark frame, k counts per electron; e counts per second. w = 0 where s is near
saturation, and where it drowns in the dark as long as another exposure does not. OpenCV's own merges are not linear.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array

NEAR_SATURATION = 0.95
NEAR_DARK = 3.0  # read noises


@dataclass(frozen=True)
class Picture:
    """Linear radiance in counts per second and its sigma, (H, W, C); saturated (H, W) in every exposure."""

    value: Array
    sigma: Array
    saturated: NDArray[np.bool_]


def merge(
    frames: list[NDArray], exposures: list[float], darks: list[Array], full: float, read: float, k: float
) -> Picture:
    """frames, darks (H, W, C) of each exposure in seconds; full = largest count; read noise in counts."""
    shape = np.atleast_3d(frames[0]).shape
    top, weight = np.zeros(shape), np.zeros(shape)
    ever = np.zeros(shape, bool)
    longest = int(np.argmax(exposures))
    for n in np.argsort(exposures)[::-1]:  # the longest first: it alone may be weak
        s, t = np.atleast_3d(frames[n]).astype(float), exposures[n]
        light = s - np.atleast_3d(darks[n])
        w = 1 / (read**2 + k * np.maximum(light, 0))
        good = s < NEAR_SATURATION * full
        if n != longest:
            good &= (light > NEAR_DARK * read) | ~ever
        w = np.where(good, w, 0.0)
        ever |= good
        top += w * t * light
        weight += w * t * t
    with np.errstate(invalid="ignore", divide="ignore"):
        value = np.where(weight > 0, top / weight, (full - np.atleast_3d(darks[-1])) / min(exposures))
        sigma = np.where(weight > 0, 1 / np.sqrt(weight), np.inf)
    return Picture(value, sigma, np.asarray(~ever.all(-1)))


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
