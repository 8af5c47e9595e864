"""A plain Metropolis chain in the thesis's simple primary sample space, for tests that need its samples."""

import numpy as np

from gonio.geometry import from_half_diff
from gonio.reconstruct import Samples

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def samples(brdf, n, seed=0, chains=16, step=0.05, p_global=0.1):
    """n measurements, rejected proposals included; target luminance of f cos(theta_o), all coordinates wrapped."""
    rng = np.random.default_rng(seed)
    weigh = LUMINANCE if brdf.channels == 3 else np.ones(brdf.channels)

    def state(u):
        theta_h, theta_d, phi_d = np.arcsin(u[:, 0]), u[:, 1] * np.pi / 2, u[:, 2] * np.pi
        wi, wo = from_half_diff(theta_h, np.zeros_like(theta_h), theta_d, phi_d)
        seen = (wi[:, 2] > 0) & (wo[:, 2] > 0)
        f = brdf.eval(wi, wo)
        area = np.tan(theta_h) * np.sin(theta_d) * np.cos(theta_d)
        return wi, wo, f, np.where(seen, f @ weigh * wo[:, 2] * area, 0), seen

    u = rng.random((chains, 3))
    w = state(u)[3]
    while np.any(w <= 0):
        again = w <= 0
        u[again] = rng.random((again.sum(), 3))
        w = state(u)[3]
    out, count = [], 0
    while count < n:
        v = (u + step * rng.standard_normal(u.shape)) % 1
        anywhere = rng.random(chains) < p_global
        v[anywhere] = rng.random((anywhere.sum(), 3))
        wi, wo, f, w_new, seen = state(v)
        out.append((wi[seen], wo[seen], f[seen]))
        count += seen.sum()
        accept = rng.random(chains) * w < w_new
        u, w = np.where(accept[:, None], v, u), np.where(accept, w_new, w)
    return Samples.of(*(np.concatenate(column)[:n] for column in zip(*out)))
