"""Draws of a material's target without a chain: what pretraining learns from and divergences are measured with.

Points even in a cube, weighted by target times Jacobian (`half`: a proposal as good for a mirror as for a wall), and
resampled by weight.
"""

from collections.abc import Callable

import numpy as np

from gonio.flow.cubes import Cube
from gonio.flow.density import LOG_MIRRORED, LOG_TURN
from gonio.geometry import Array, above_horizon


def weighted(cube: Cube, log_target: Callable[[Array, Array], Array], count: int, rng: np.random.Generator):
    """x (N, D) even in the cube (Sobol-like by strata of the first coordinate) and log target x Jacobian (N,).

    log_target(wi, wo) is asked only above the horizon; -inf elsewhere.
    """
    x = rng.random((count, cube.dimensions))
    x[:, 0] = (np.arange(count) + x[:, 0]) / count
    wi, wo = cube.to_directions(x)
    up = above_horizon(wi, wo)
    log_w = np.full(count, -np.inf)
    log_w[up] = log_target(wi[up], wo[up]) + cube.log_jacobian(x[up], wi[up], wo[up])
    return x, log_w


def resampled(x: Array, log_w: Array, count: int, rng: np.random.Generator) -> Array:
    """`count` points of x drawn by weight, systematically: no point more often than its weight asks for by one."""
    w = np.exp(log_w - log_w.max())
    comb = (np.arange(count) + rng.random()) / count
    i = np.minimum(np.searchsorted(np.cumsum(w) / w.sum(), comb), len(x) - 1)
    return x[rng.permutation(i)]


def divergence(density, cube: Cube, x: Array, log_w: Array) -> float:
    """KL(target || density) in nats, from `weighted` points: E_p[log p - log q], p normalised over all of the cube.

    density has `log_prob(wi, wo)`, solid angles of both.
    """
    w = np.exp(log_w - log_w.max())
    norm = w.mean()
    i = np.flatnonzero(w > 1e-9 * w.max())
    wi, wo = cube.to_directions(x[i])
    folded = LOG_MIRRORED + LOG_TURN if cube.dimensions == 3 else 0.0
    # both as densities over the cube
    log_q = density.log_prob(wi, wo) + cube.log_jacobian(x[i], wi, wo) + folded
    log_p = log_w[i] - log_w.max() - np.log(norm)
    return float(np.sum(w[i] * (log_p - log_q)) / w.sum())
