"""A square in which sharp lobes, broad ones and their sums are smooth, to bin and to integrate in.

The half vector's slopes are tan(theta_h) (cos(phi_h), sin(phi_h)) = r (alpha_x cos(phi), alpha_y sin(phi)); the
square's axes are phi / 2 pi and s = the mean of r / (w + r) over widths w = 1, 10, 100 ... up to a slope of 1.
alpha: one number or (alpha_x, alpha_y). Coarse bins on the sphere itself would fail correct sharp lobes.
"""

import numpy as np
from scipy.stats import chi2

from gonio.geometry import half_vector, reflect, unit


def _widths(alpha):
    return 10.0 ** np.arange(1 + np.ceil(-np.log10(np.max(alpha))))


def _s(r, alpha):
    w = _widths(alpha)
    return np.mean(r[:, None] / (w + r[:, None]), axis=1), np.mean(w / (w + r[:, None]) ** 2, axis=1)


def _radius(s, alpha):
    """r at s and ds/dr there; by bisection of its logarithm."""
    low, high = np.full(len(s), -30.0), np.full(len(s), 30.0)
    for _ in range(60):
        mid = 0.5 * (low + high)
        below = _s(np.exp(mid), alpha)[0] < s
        low, high = np.where(below, mid, low), np.where(below, high, mid)
    r = np.exp(low)
    return r, _s(r, alpha)[1]


def grid(wi, alpha, bins, fine):
    """wo (N, 3) at the centres of (bins fine)^2 cells of the square for one wi (3,), and the cells' solid angles."""
    n = bins * fine
    centres = (np.arange(n) + 0.5) / n
    r, slope = _radius(centres, alpha)
    r, slope, phi = np.repeat(r, n), np.repeat(slope, n), np.tile(2 * np.pi * centres, n)
    alpha_x, alpha_y = np.broadcast_to(alpha, 2)
    h = unit(np.stack([alpha_x * r * np.cos(phi), alpha_y * r * np.sin(phi), np.ones_like(r)], -1))
    area = h[:, 2] ** 3 * alpha_x * alpha_y * r / slope * 2 * np.pi / n**2
    wi = np.broadcast_to(wi, h.shape)
    return reflect(wi, h), area * 4 * np.maximum(np.einsum("ni,ni->n", wi, h), 0)


def place(wi, alpha, wo):
    """(s, phi / 2 pi) of directions wo (N, 3)."""
    h = half_vector(np.broadcast_to(wi, wo.shape), wo)
    x, y = (h[:, :2] / h[:, 2:] / np.broadcast_to(alpha, 2)).T
    return _s(np.hypot(x, y), alpha)[0], np.arctan2(y, x) / (2 * np.pi) % 1


def integrals(function, wi, alpha, bins=16, fine=24):
    """Integral of function(wi, wo) -> (N,) over the solid angle of each of bins x bins cells, by midpoints."""
    wo, area = grid(wi, alpha, bins, fine)
    p = function(np.broadcast_to(wi, wo.shape), wo) * area
    return p.reshape(bins, fine, bins, fine).sum((1, 3))


def p_value(wo, pdf, wi, alpha, expected):
    """Pearson's test of draws wo (N, 3) whose density was said to be pdf (N,), 0 = lost, against cells' probabilities.

    The lost draws are a cell of their own; cells with fewer than ten expected are pooled.
    """
    bins, n = len(expected), len(wo)
    s, t = place(wi, alpha, wo[pdf > 0])
    i, j = (np.clip((a * bins).astype(int), 0, bins - 1) for a in (s, t))
    seen = np.append(np.bincount(i * bins + j, minlength=bins * bins).astype(float), np.sum(pdf == 0))
    wanted = n * np.append(expected.ravel(), max(1 - expected.sum(), 0))
    order = np.argsort(wanted)
    seen, wanted = seen[order], wanted[order]
    few = np.searchsorted(np.cumsum(wanted), 10.0) + 1
    seen, wanted = np.append(seen[few:], seen[:few].sum()), np.append(wanted[few:], wanted[:few].sum())
    return chi2.sf(np.sum((seen - wanted) ** 2 / np.maximum(wanted, 1e-9)), len(seen) - 1)


def sample_p_value(brdf, wi, alpha, n=40_000, seed=1, fine=24, pdf=None):
    """P value of `brdf.sample` against `pdf` (its own unless given)."""
    u = np.random.default_rng(seed).random((n, 2))
    return p_value(*brdf.sample(np.tile(wi, (n, 1)), u), wi, alpha, integrals(pdf or brdf.pdf, wi, alpha, 16, fine))
