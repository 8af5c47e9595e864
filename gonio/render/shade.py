"""A sphere of the material under a sky and three lamps, shaded in NumPy: enough to see what a report is about.

Orthographic view along -z. Each pixel's radiance is an integral of L(w) f cos over the hemisphere, estimated by
multiple importance sampling (balance heuristic, Veach 1997) of the BRDF's own sampler and of the lamps' discs.
Two BRDFs shaded with the same `sampler` and seed see the same directions, so that their difference shows no noise.
"""

import numpy as np

from gonio.brdf import Brdf
from gonio.geometry import Array, from_angles, unit

# towards the lamp (camera frame: x right, y up, z to the viewer), angular radius in degrees, radiance
LAMPS = (((-0.6, 0.7, 0.55), 4.0, 60.0), ((0.8, 0.35, 0.4), 2.5, 80.0), ((0.1, -0.5, 0.8), 8.0, 4.0))


def sky(w: Array) -> Array:
    """Radiance (N, 3) from directions w: pale zenith, blue horizon, brown ground; smooth, linear RGB."""
    up = w[:, 1:2]
    t = 0.5 * (1 + np.tanh(4 * up))
    above = np.array([0.55, 0.75, 1.0]) * (0.6 + 0.6 * np.clip(up, 0, 1))
    return t * above + (1 - t) * np.array([0.18, 0.14, 0.10])


def render_sphere(brdf: Brdf, size: int = 160, spp: int = 24, sampler: Brdf | None = None, seed: int = 1) -> Array:
    """Linear RGB image (size, size, 3), background 0. wi is towards the viewer, as in a renderer.

    sampler is the BRDF that draws directions (default: `brdf`). One channel is shown as grey, of more than three the
    first three.
    """
    sampler = sampler or brdf
    rng = np.random.default_rng(seed)
    normal, inside = _sphere(size)
    frame = _frames(normal)  # rows: tangent, bitangent, normal
    view = np.array([0.0, 0.0, 1.0])
    wi = frame @ view
    total = np.zeros((len(normal), 3))
    lamps = [(unit(np.array(d)), np.radians(r), power) for d, r, power in LAMPS]
    for _ in range(spp):
        wo, pdf = sampler.sample(wi, rng.random((len(wi), 2)))
        good = (pdf > 0) & (wo[:, 2] > 0)
        i = np.flatnonzero(good)
        world = np.einsum("nij,ni->nj", frame[i], wo[i])
        light = sky(world)
        f = _rgb(brdf.eval(wi[i], wo[i])) * wo[i, 2:3]
        for axis, radius, power in lamps:
            hit = world @ axis > np.cos(radius)
            share = pdf[i] / (pdf[i] + _disc_pdf(radius))
            light = light + (hit * power * share)[:, None]
        total[i] += f * light / pdf[i, None]
        for axis, radius, power in lamps:
            world = _disc(axis, radius, rng.random((len(wi), 2)))
            wo = np.einsum("nij,nj->ni", frame, world)
            i = np.flatnonzero(wo[:, 2] > 0)
            f = _rgb(brdf.eval(wi[i], wo[i])) * wo[i, 2:3]
            total[i] += f * power / (_disc_pdf(radius) + sampler.pdf(wi[i], wo[i]))[:, None]
    image = np.zeros((size * size, 3))
    image[inside] = total / spp
    return image.reshape(size, size, 3)


def to_srgb(image: Array, exposure: float = 1.0) -> Array:
    """Display values in [0, 1] of linear RGB, clipped (IEC 61966-2-1)."""
    x = np.clip(image * exposure, 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * np.maximum(x, 1e-9) ** (1 / 2.4) - 0.055)


def psnr(image: Array, reference: Array) -> float:
    """Peak signal-to-noise ratio in dB of linear images clipped to [0, 1]."""
    error = np.mean((np.clip(image, 0, 1) - np.clip(reference, 0, 1)) ** 2)
    return float(-10 * np.log10(error)) if error > 0 else float("inf")


def _sphere(size: int) -> tuple[Array, Array]:
    """Normals (M, 3) of the pixels that show the sphere, and their flat indices."""
    t = (np.arange(size) + 0.5) / size * 2.1 - 1.05
    x, y = np.meshgrid(t, -t)
    r2 = (x * x + y * y).ravel()
    inside = np.flatnonzero(r2 < 0.998)
    x, y, r2 = x.ravel()[inside], y.ravel()[inside], r2[inside]
    return np.stack([x, y, np.sqrt(1 - r2)], -1), inside


def _frames(normal: Array) -> Array:
    tangent = unit(np.stack([normal[:, 2], np.zeros(len(normal)), -normal[:, 0]], -1))
    return np.stack([tangent, np.cross(normal, tangent), normal], 1)


def _disc(axis: Array, radius: float, u: Array) -> Array:
    """Directions uniform in the cone about axis."""
    theta = 2 * np.arcsin(np.sqrt(u[:, 0]) * np.sin(radius / 2))
    local = from_angles(theta, 2 * np.pi * u[:, 1])
    return local @ _frames(axis[None])[0]


def _disc_pdf(radius: float) -> float:
    return 1 / (2 * np.pi * 2 * np.sin(radius / 2) ** 2)


def _rgb(f: Array) -> Array:
    return np.repeat(f, 3, 1) if f.shape[1] == 1 else f[:, :3] if f.shape[1] > 2 else np.pad(f, ((0, 0), (0, 1)))
