"""Where a mirror throws the light: a search in a spiral, a climb, and a fit of the peak's centre in both directions.

The plane of the search is (u, v), rad: how far the direction looked in lies beside the one in which the mirror should
throw the light. At the end nine readings about the top give

    log(signal) = a + g w + w H w / 2,   centre = -H^-1 g

with the covariance that their sigmas give it: no shape is assumed but that it is smooth at the top and falls.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array

Look = Callable[[Array], tuple[Array, float, float]]  # where in the plane (2,) -> where really, signal, its sigma

PITCH = np.radians(1.0)  # of the spiral
STEP = np.radians(0.4)  # of the first grid
SEEN = 30.0  # sigmas above the dark
MOVES = 20  # of the grid, before there is no top
GRID = np.stack(np.meshgrid([-1.0, 0, 1], [-1.0, 0, 1], indexing="ij"), -1).reshape(-1, 2)
SYSTEMATIC = 0.005  # of a signal: its range, its linearity
FACETS, FAR, SECOND = 12, (5.0, 8.0), 0.03  # a ring's readings, in widths; a second peak is this bright


class OutOfReach(Exception):
    """A look that leads beyond the limits of an axis, or to where no clear way goes."""


class NoPeak(Exception):
    """Nothing to be seen, or not one peak: says what."""


@dataclass(frozen=True)
class Peak:
    """centre (2,) and its covariance (2, 2), rad; width, rad (sd of a Gaussian as curved); signal at the top."""

    centre: Array
    covariance: Array
    width: float
    signal: float


def find_peak(look: Look, radius: float, *, alone: bool = False) -> Peak:
    """The peak within `radius` rad of where it should be. alone: confirm that there is no second one beside it.

    Raises NoPeak; OutOfReach where a part of the peak lies there.
    """
    seen: list[tuple[Array, float, float]] = []

    def bright(w: Array) -> bool:
        seen.append(look(w))
        return seen[-1][1] > SEEN * seen[-1][2]

    start = np.zeros(2)
    if not bright(start):
        for w in spiral(radius, PITCH):
            with suppress(OutOfReach):  # the peak may well be where the rig can be
                if bright(w):
                    break
        else:
            signal, sigma = max((s, e) for _, s, e in seen)
            why = "nothing but darkness: is the lamp on?" if signal < 5 * sigma else "is the mirror level and clean?"
            raise NoPeak(f"no peak within {np.degrees(radius):.0f} degrees of where it should be; {why}")
        start = seen[-1][0]
    step = STEP
    for _ in range(MOVES):
        grid = [look(start + step * g) for g in GRID]
        seen += grid
        top = int(np.argmax([s for _, s, _ in grid]))
        if not np.abs(GRID[top]).any():
            peak = _fit(grid)
            if peak is not None and np.abs(peak.centre - start).max() < step and 0.4 < step / peak.width < 1.3:
                break
            if peak is not None and np.abs(peak.centre - start).max() < 2 * step:
                start, step = peak.centre, float(np.clip(0.8 * peak.width, step / 2, 2 * step))
                continue
        start = grid[top][0]
    else:
        raise NoPeak("what is seen has no top: the mirror is bent, or its light is wider than the search")
    if alone:
        _confirm_alone(look, peak)
    return peak


def _fit(grid: list[tuple[Array, float, float]]) -> Peak | None:
    """A peak through readings; None where they are not curved downwards everywhere."""
    w = np.array([g[0] for g in grid])
    signal, sigma = np.array([g[1] for g in grid]), np.array([g[2] for g in grid])
    if not (signal > 0).all():
        return None
    middle = w.mean(0)
    u, v = (w - middle).T
    design = np.stack([np.ones_like(u), u, v, u * u / 2, u * v, v * v / 2], 1)
    weight = 1 / np.hypot(sigma / signal, SYSTEMATIC)
    scale = np.abs(design).max(0)
    solved, *_ = np.linalg.lstsq(design / scale * weight[:, None], np.log(signal) * weight, rcond=None)
    a, *g, huu, huv, hvv = solved / scale
    h = np.array([[huu, huv], [huv, hvv]])
    if not np.linalg.eigvalsh(h)[1] < 0:
        return None
    normal = (design * weight[:, None]).T @ (design * weight[:, None])
    inverse = np.linalg.inv(h)
    centre = -inverse @ np.array(g)
    slope = np.zeros((2, 6))
    slope[:, 1:3] = -inverse
    for k, e in ((3, [[1, 0], [0, 0]]), (4, [[0, 1], [1, 0]]), (5, [[0, 0], [0, 1]])):
        slope[:, k] = -inverse @ np.array(e, float) @ centre
    covariance = slope @ np.linalg.inv(normal) @ slope.T
    width = float(np.linalg.det(-inverse) ** 0.25)
    top = float(np.exp(a + np.array(g) @ centre / 2))
    return Peak(middle + centre, covariance, width, top)


def _confirm_alone(look: Look, peak: Peak) -> None:
    """Look about the peak for another. Raises NoPeak."""
    for k, far in enumerate(FAR):
        for angle in 2 * np.pi * (np.arange(FACETS) + 0.5 * k) / FACETS:
            there = far * peak.width * np.array([np.cos(angle), np.sin(angle)])
            if look(peak.centre + there)[1] > SECOND * peak.signal:
                raise NoPeak(
                    f"two peaks, {np.degrees(np.hypot(*there)):.1f} degrees apart: "
                    "the mirror is cracked, or two lie there"
                )


def spiral(radius: float, pitch: float) -> Array:
    """Points (N, 2) outwards on a spiral of Archimedes, `pitch` apart in both ways."""
    turn, points = np.pi, []
    while (r := pitch * turn / (2 * np.pi)) < radius:
        points.append([r * np.cos(turn), r * np.sin(turn)])
        turn += pitch / max(r, pitch)
    return np.array(points).reshape(-1, 2)
