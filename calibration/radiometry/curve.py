"""What a detector makes of light over four decades, from exposures and lamp levels together.

    shown = rho_r s (1 + x s / F_r),   s = L_l t b_c (1 + d T) + dark_c(t)

rho_r the ratio of range r to the lowest, x the excess at full scale F_r, L_l what the lamp really gives at a level
(1 at the first), b_c the reference's signal per second, d the lamp's drift a second since T = 0. Exposures t are exact,
levels are not: each is found. Signals of one level at many exposures cross the ranges, and those of many levels at one
exposure meet again: that tells ratios and linearity apart (flux addition; Saunders & Shumaker 1984).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array

BEND, RATIO = 0.2, 0.1  # priors


@dataclass(frozen=True)
class Point:
    """Mean of n readings at one level, exposure and choice of ranges: value, sigma (C,) of the mean, scatter (C,) of
    one."""

    level: int
    seconds: float
    time: float
    ranges: tuple[int, ...]
    full: Array
    value: Array
    sigma: Array
    scatter: Array
    n: int


@dataclass(frozen=True)
class Curve:
    """ratios (R,), the lowest 1; linearity x; levels (L,), b (C,), drift, each with its sigma; off: misses in relation
    to the signal (N, C), rms of their sigmas."""

    ratios: Array
    ratios_sigma: Array
    linearity: float
    linearity_sigma: float
    levels: Array
    b: Array
    drift: float
    drift_sigma: float
    covariance: Array
    off: Array
    excess: float


def fit_curve(
    points: Sequence[Point],
    dark: Array,
    ranges: int,
    drift: tuple[float, float],
    known: tuple[float, float] = (BEND, RATIO),
) -> Curve:
    """dark (2, C): signal at no exposure, and a second; drift: of the lamp, relative in a second, and its sigma, as
    known before. known: how far from 0 the linearity and from 1 the ratios may be before anything is read; ranges that
    no point reached stay at that, and so does all of a meter that reads a rate: its exposures tell nothing."""
    bend, ratio = known
    from scipy.optimize import least_squares

    level = np.array([p.level for p in points])
    t, time = np.array([p.seconds for p in points])[:, None], np.array([p.time for p in points])[:, None]
    r, full = np.array([p.ranges for p in points]), np.array([p.full for p in points])
    value, sigma = np.array([p.value for p in points]), np.array([p.sigma for p in points])
    n_levels, channels = int(level.max()) + 1, value.shape[1]
    first = np.median(((value - dark[0] - dark[1] * t) / t)[level == 0], 0)
    cuts = np.cumsum([channels, n_levels - 1, ranges - 1])

    def parts(p: Array):
        b, levels, ratios, rest = np.split(p, cuts)
        full_levels = np.exp(np.concatenate([[0.0], levels]))
        return first * np.exp(b), full_levels, np.exp(np.concatenate([[0.0], ratios])), rest[0], rest[1] / 3600

    def shown(p: Array) -> Array:
        b, levels, ratios, x, lamp = parts(p)
        s = levels[level][:, None] * t * b * (1 + lamp * time) + dark[0] + dark[1] * t
        return ratios[r] * s * (1 + x * s / full)

    def residual(p: Array) -> Array:
        _, _, ratios, x, lamp = parts(p)
        priors = np.concatenate([np.log(ratios[1:]) / ratio, [x / bend, (lamp - drift[0]) / drift[1]]])
        return np.concatenate([((shown(p) - value) / sigma).ravel(), priors])

    begin = np.zeros(cuts[-1] + 2)
    begin[-1] = drift[0] * 3600
    guess = [np.log(np.median(((value - dark[0]) / t / first)[level == k])) for k in range(1, n_levels)]
    begin[channels : channels + n_levels - 1] = guess
    fit = least_squares(residual, begin, x_scale="jac")
    b, levels, ratios, x, lamp = parts(fit.x)
    freedom = max(value.size - (len(fit.x) - ranges - 1), 1)
    excess = float(np.sqrt((fit.fun[: value.size] ** 2).sum() / freedom))
    covariance = np.linalg.inv(fit.jac.T @ fit.jac) * max(excess, 1.0) ** 2
    spread = np.sqrt(np.diag(covariance))
    off = (value - shown(fit.x)) / np.maximum(np.abs(value), 1e-300)
    of_ratios = ratios * np.concatenate([[0.0], spread[cuts[1] : cuts[2]]])
    return Curve(
        ratios,
        of_ratios,
        float(x),
        float(spread[-2]),
        levels,
        b,
        float(lamp),
        float(spread[-1]) / 3600,
        covariance,
        off,
        excess,
    )


def photon_transfer(points: Sequence[Point], dark: Array, unit_s: float) -> tuple[float, float]:
    """Shot noise (relative, of a signal of 1) and read noise of one reading, by the scatter of readings against their
    mean: variance = read^2 + shot^2 light, weighted least squares (Janesick 2007)."""
    light = np.concatenate([np.maximum(p.value - dark[0] - dark[1] * p.seconds, 0) for p in points if p.n >= 8])
    variance = np.concatenate([p.scatter**2 for p in points if p.n >= 8])
    steps = np.concatenate([np.full(len(p.value), float(p.n - 1)) for p in points if p.n >= 8])
    shot2, read2 = 2.5e-5, 1e-8
    for _ in range(20):  # the weight of a variance is its own square: iterated
        expected = np.maximum(read2 + shot2 * light, 1e-300)
        w = np.sqrt(steps / 2) / expected
        design = np.stack([light, np.ones_like(light)], 1) * w[:, None]
        scale = np.linalg.norm(design, axis=0)
        solved = np.linalg.lstsq(design / scale, variance * w, rcond=None)[0] / scale
        shot2, read2 = max(float(solved[0]), 1e-18), max(float(solved[1]), 1e-18)
    return float(np.sqrt(shot2)), float(np.sqrt(read2))
