"""Two periodic surfaces: metal brushed along x, and a plain weave of two yarns.

Heights are in steps of the grid, so that differences of neighbours are slopes.
"""

from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array

CELLS = 256


@dataclass(frozen=True)
class Shape:
    """height (n, n), h[i, j] at (x, y) = (i, j), repeated for ever. Facets are a Lambert part and a GGX lobe of
    roughness alpha: diffuse, f0 (n, n, 3) and (n, n, 3)."""

    height: Array
    alpha: float
    diffuse: Array
    f0: Array


def brushed(seed: int, slopes: tuple[float, float] = (0.03, 0.22), lengths: tuple[float, float] = (40.0, 2.5)) -> Shape:
    """Gaussian noise with a Gaussian correlation of `lengths` along x and y, scaled to the rms slope across, slopes[1];
    a second, finer noise makes up slopes[0] along the grooves. A copper-like metal."""
    rng = np.random.default_rng(seed)
    across = _noise(rng, lengths)
    across *= slopes[1] / np.sqrt(np.mean(_gradient(across)[1] ** 2))
    along = _noise(rng, (4.0, 4.0))
    along *= slopes[0] / np.sqrt(np.mean(_gradient(along)[0] ** 2))
    everywhere = np.ones((CELLS, CELLS, 1))
    return Shape(across + along, 0.09, 0.01 * everywhere * [1, 1, 1], everywhere * [0.93, 0.62, 0.45])


def woven(crown: float = 0.35, yarns: int = 4) -> Shape:
    """Plain weave: `yarns` warp yarns along y and as many weft yarns along x to a period, each of round section, that
    go over and under each other by turns; the upper one is seen. The two are of different colours."""
    width = CELLS / yarns
    x = np.arange(CELLS) + 0.5
    section = np.sqrt(np.maximum(1 - (2 * (x % width) / width - 1) ** 2, 0))  # across a yarn, 0 ... 1
    sign = np.where((x // width).astype(int) % 2 == 0, 1.0, -1.0)
    warp = section[:, None] + sign[:, None] * _over(x, width)[None, :]
    weft = section[None, :] - sign[None, :] * _over(x, width)[:, None]
    top = warp >= weft
    height = crown * width / 2 * np.maximum(warp, weft)
    colours = np.where(top[..., None], [0.35, 0.05, 0.06], [0.04, 0.08, 0.30])
    return Shape(height, 0.3, colours, np.full((CELLS, CELLS, 3), 0.05))


def _over(x: Array, width: float) -> Array:
    """How far the first yarn lies above the middle along its way, -1 ... 1: over the even crossings."""
    return np.cos(np.pi * (x / width - 0.5))


def _noise(rng: np.random.Generator, lengths: tuple[float, float]) -> Array:
    k = 2 * np.pi * np.fft.fftfreq(CELLS)
    kx, ky = np.meshgrid(k, k, indexing="ij")
    window = np.exp(-((kx * lengths[0]) ** 2 + (ky * lengths[1]) ** 2) / 4)
    return np.fft.ifft2(np.fft.fft2(rng.standard_normal((CELLS, CELLS))) * window).real


def _gradient(h: Array) -> tuple[Array, Array]:
    """dh/dx, dh/dy by central differences around the period."""
    dx, dy = (0.5 * (np.roll(h, -1, axis) - np.roll(h, 1, axis)) for axis in (0, 1))
    return dx, dy


def normals(h: Array) -> Array:
    """(n, n, 3)."""
    dx, dy = _gradient(h)
    n = np.stack([-dx, -dy, np.ones_like(h)], -1)
    return n / np.linalg.norm(n, axis=-1, keepdims=True)
