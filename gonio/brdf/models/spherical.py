"""The spherical Gaussian (von Mises-Fisher): kappa / (4 pi sinh kappa) exp(kappa mu.w), symmetric in (mu, w).

The cosine about mu is drawn by the inverse of its cumulative in the form of Jakob (2012), which neither overflows at
large kappa nor cancels at small: 1 - cos t = -log(1 - xi (1 - exp(-2 kappa))) / kappa.
"""

import numpy as np

from gonio.geometry import Array

PI = np.pi


def log_vmf(cos_t: Array, kappa: float) -> Array:
    """log of the density at the cosine cos_t about the mean direction, solid angle; stable for kappa in 1e-3 ...
    1e6."""
    return np.log(kappa / (2 * PI)) - np.log(-np.expm1(-2 * kappa)) + kappa * (np.asarray(cos_t) - 1)


def log_vmf_between(mu: Array, w: Array, kappa: float) -> Array:
    """log of the density from two unit vectors, by |mu - w|^2 = 2 (1 - cos t): exact where the two nearly agree."""
    return np.log(kappa / (2 * PI)) - np.log(-np.expm1(-2 * kappa)) - 0.5 * kappa * np.sum((mu - w) ** 2, -1)


def sample_vmf(mu: Array, kappa: float, u1: Array, u2: Array) -> Array:
    """Directions (N, 3) about unit vectors mu (N, 3)."""
    v = np.minimum(-np.log1p(u1 * np.expm1(-2 * kappa)) / kappa, 2.0)  # 1 - cos t
    sin_t = np.sqrt(v * (2 - v))
    phi = 2 * PI * u2
    # orthonormal basis of Duff et al. (2017), no branch but the sign of z
    x, y, z = mu.T
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    s = np.stack([1 + sign * x * x * a, sign * b, -sign * x], -1)
    t = np.stack([b, sign + y * y * a, -y], -1)
    w = (sin_t * np.cos(phi))[:, None] * s + (sin_t * np.sin(phi))[:, None] * t + (1 - v)[:, None] * mu
    return w / np.linalg.norm(w, axis=1, keepdims=True)
