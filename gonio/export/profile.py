"""What a BRDF's half vectors look like: a distribution of normals for tables to follow. Azimuth rows cover -pi..pi."""

import numpy as np

from gonio.brdf import Brdf
from gonio.geometry import Array, above_horizon, from_angles, from_half_diff

THETA_D = np.radians([3.0, 20.0, 40.0, 60.0])
PHI_D = np.radians(np.arange(11.25, 360, 22.5))
FLOOR = 1e-6  # of the largest value: D divides


def half_profile(brdf: Brdf, columns: int, rows: int) -> Array:
    """(rows, columns), > 0: mean over theta_d, phi_d and channels of f cos(theta_i) cos(theta_o) at (theta_h, phi_h).

    Columns are even in sqrt(theta_h). Normalised so that the integral of D cos(theta_h) is 1. Rows are equal where
    rows = 2 (an isotropic surface).
    """
    theta_h = np.pi / 2 * np.linspace(0, 1, columns) ** 2
    phi_h = np.zeros(1) if rows == 2 else np.linspace(-np.pi, np.pi, rows)
    grid = np.meshgrid(phi_h, theta_h, THETA_D, PHI_D, indexing="ij")
    wi, wo = from_half_diff(*(grid[k].ravel() for k in (1, 0, 2, 3)))
    seen = above_horizon(wi, wo)
    value, count = np.zeros(len(wi)), seen.astype(float)
    value[seen] = brdf.eval(wi[seen], wo[seen]).mean(1) * wi[seen, 2] * wo[seen, 2]
    shape = (len(phi_h), columns, -1)
    count = count.reshape(shape).sum(-1)
    mean = value.reshape(shape).sum(-1) / np.maximum(count, 1)
    # where too little of the circle is above the horizon, go on from the last theta_h that is well seen
    last = np.flatnonzero((count >= len(PHI_D) / 2).all(0))[-1]
    mean[:, last:] = mean[:, last : last + 1]
    mean = np.maximum(np.nan_to_num(mean, nan=0.0, posinf=1e30), 0)
    if not mean.any():
        mean[:] = 1
    d = np.maximum(_smooth(mean), FLOOR * mean.max())
    if rows == 2:
        d = np.repeat(d, 2, axis=0)
    return d / _cosine_integral(d)


def turns(brdf: Brdf) -> bool:
    """Whether `brdf` changes by more than 1 % when the sample is turned under light and detector: anisotropic."""
    rng = np.random.default_rng(0)
    angles = np.arctan(10 ** rng.uniform(-3, 0, 200)), 2 * np.pi * rng.random(200), rng.uniform(0, 1.26, 200)
    wi, wo = from_half_diff(*angles, 2 * np.pi * rng.random(200))
    seen = above_horizon(wi, wo)
    wi, wo = wi[seen], wo[seen]
    f = brdf.eval(wi, wo).mean(1)
    for angle in (0.4, 1.1, 1.9, 3.0):
        turned = brdf.eval(_turned(wi, angle), _turned(wo, angle)).mean(1)
        with np.errstate(invalid="ignore"):  # of values that are not finite the exporter complains itself
            if np.mean(np.abs(turned - f) / (turned + f + 1e-6 * f.max() + 1e-300)) > 0.005:
                return True
    return False


def _turned(w: Array, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([c * w[:, 0] - s * w[:, 1], s * w[:, 0] + c * w[:, 1], w[:, 2]], -1)


def half_width(d: Array) -> float:
    """theta_h in rad at which the mean profile falls below half of its largest value."""
    mean = d.mean(0)
    below = np.flatnonzero(mean < 0.5 * mean.max())
    beyond = below[below > np.argmax(mean)]
    u = (beyond[0] if len(beyond) else len(mean) - 1) / (len(mean) - 1)
    return float(np.pi / 2 * u * u)


def projected_area(d: Array, columns: int, rows: int) -> Array:
    """sigma(wi) (rows, columns) = integral of D(m) max(0, wi.m), columns even in sqrt(theta_i)."""
    n, azimuths = d.shape[1], 48
    u = (np.arange(n) + 0.5) / n
    theta, phi = np.pi / 2 * u * u, -np.pi + 2 * np.pi * (np.arange(azimuths) + 0.5) / azimuths
    fine = np.array([np.interp(u, np.linspace(0, 1, n), row) for row in d])
    turn = np.linspace(-np.pi, np.pi, len(d))
    value = np.array([np.interp(phi, turn, column) for column in fine.T]).T  # (azimuths, n)
    mass = (value * np.sin(theta) * np.pi * u / n * 2 * np.pi / azimuths).ravel()
    m = from_angles(np.tile(theta, azimuths), np.repeat(phi, n))
    theta_i = np.pi / 2 * np.linspace(0, 1, columns) ** 2
    phi_i = np.zeros(1) if rows == 2 else np.linspace(-np.pi, np.pi, rows)
    sigma = np.array([mass @ np.maximum(m @ from_angles(theta_i, p).T, 0) for p in phi_i])
    return np.repeat(sigma, 2, axis=0) if rows == 2 else sigma


def _smooth(d: Array) -> Array:
    """Noise out of a profile: a running mean of logarithms over 5 columns, 3 rows where there are rows."""
    log = np.log(np.maximum(d, 1e-12 * d.max()))
    padded = np.pad(log, ((0, 0), (2, 2)), mode="edge")
    out = sum(w * padded[:, k : k + log.shape[1]] for k, w in enumerate((1, 4, 6, 4, 1))) / 16
    return np.exp(np.minimum(out, log.max()))


def _cosine_integral(d: Array) -> float:
    u = np.linspace(0, 1, d.shape[1])
    theta = np.pi / 2 * u * u
    g = d.mean(0) * np.cos(theta) * np.sin(theta) * np.pi * u * 2 * np.pi
    return float(np.sum(0.5 * (g[1:] + g[:-1])) / (len(u) - 1))
