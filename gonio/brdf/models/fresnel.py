"""Fresnel reflectance against c = cos(theta_d), (N,) -> (N, C)."""

import numpy as np

from gonio.geometry import Array


def schlick(c: Array, f0: Array) -> Array:
    """Schlick 1994: f0 at normal incidence, (C,), 1 at grazing."""
    x = 1 - np.clip(c, 0, 1)
    x2 = x * x  # a fifth power by pow() costs as much as all the rest of a lobe
    return f0 + (1 - f0) * (x2 * x2 * x)[:, None]


def conductor(c: Array, eta, k) -> Array:
    """Exact unpolarised reflectance of a surface with refractive index eta + i k, (C,) each; k = 0 is a dielectric."""
    c = np.clip(c, 0, 1)[:, None]
    c2, s2 = c * c, 1 - c * c
    t0 = eta**2 - k**2 - s2
    ab = np.sqrt(t0 * t0 + 4 * eta**2 * k**2)  # a^2 + b^2 of the refracted wave
    a = np.sqrt(np.maximum(0.5 * (ab + t0), 0))
    rs = (ab + c2 - 2 * a * c) / (ab + c2 + 2 * a * c)
    t = c2 * ab + s2 * s2
    rp = rs * (t - 2 * a * c * s2) / np.maximum(t + 2 * a * c * s2, 1e-300)
    return np.clip(0.5 * (rs + rp), 0, 1)
