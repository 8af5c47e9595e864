"""How good a BRDF is beside a known one: the referee's figures.

Over nine incidence angles 5 ... 80 degrees and all channels, with f^ the BRDF judged and f the truth:

    energy    integral |f^ - f| cos(theta_o) dwo / integral f cos(theta_o) dwo: energy in the wrong place or amount
              (its median, mean and max; energy_worst_channel is the largest mean of one channel)
    bright    integral f^ cos / integral f cos: below 1 too dark, above 1 too bright
    log       mean |ln((f^ cos + e) / (f cos + e))| over directions uniform in solid angle, e = 1e-3 of the mean f cos
    grazing   energy at 80 degrees

The quadrature draws wo from a uniform density and four GGX half-vector densities with a fixed seed, weighted by the
balance heuristic (Veach 1997), so that peaks of any width are seen.
"""

import numpy as np

from gonio.brdf import Brdf
from gonio.geometry import Array, from_angles, half_vector, reflect

THETA_I = np.radians(np.linspace(5, 80, 9))
ALPHAS = (0.005, 0.02, 0.08, 0.3)


def directions(n: int = 4000, seed: int = 7, theta_i: Array = THETA_I):
    """Per incidence angle: wi, wo (M, 3), weights (M,) of the quadrature over wo, and which draws were uniform (M,)."""
    rng, m = np.random.default_rng(seed), n // (len(ALPHAS) + 1)
    for theta in theta_i:
        wi = np.array([np.sin(theta), 0, np.cos(theta)])
        z, phi = rng.random(m), 2 * np.pi * rng.random(m)
        r = np.sqrt(1 - z * z)
        parts = [np.stack([r * np.cos(phi), r * np.sin(phi), z], -1)]
        for alpha in ALPHAS:
            u, phi = rng.random(m), 2 * np.pi * rng.random(m)
            h = from_angles(np.arctan(alpha * np.sqrt(u / (1 - u))), phi)
            parts.append(reflect(np.broadcast_to(wi, h.shape), h))
        wo = np.concatenate(parts)
        uniform = np.arange(len(wo)) < m
        keep = wo[:, 2] > 1e-3
        wo, uniform = wo[keep], uniform[keep]
        h = half_vector(wi, wo)
        c2, s2 = h[:, 2] ** 2, h[:, 0] ** 2 + h[:, 1] ** 2
        pdf = np.full(len(wo), 1 / (2 * np.pi))
        for alpha in ALPHAS:
            d = alpha**2 / (np.pi * (c2 * alpha**2 + s2) ** 2)
            pdf = pdf + d * h[:, 2] / (4 * np.abs(h @ wi) + 1e-12)
        yield np.broadcast_to(wi, wo.shape).copy(), wo, (len(ALPHAS) + 1) / (pdf * n), uniform


def evaluate(brdf: Brdf, truth: Brdf, n: int = 4000, seed: int = 7, theta_i: Array = THETA_I) -> dict[str, float]:
    """The figures of the module's text, or at other incidences theta_i (radians).

    Raises ValueError where the two do not have the same channels.
    """
    if brdf.channels != truth.channels:
        raise ValueError(f"{brdf.channels} channels cannot be compared with the truth's {truth.channels}")
    energy, bright, log = [], [], []
    for wi, wo, weight, uniform in directions(n, seed, theta_i):
        got, want = brdf.eval(wi, wo), truth.eval(wi, wo)
        cos = wo[:, 2:3]
        w = weight[:, None]
        total = np.sum(want * cos * w, 0)
        energy.append(np.sum(np.abs(got - want) * cos * w, 0) / total)
        bright.append(np.sum(got * cos * w, 0) / total)
        e = 1e-3 * total / np.pi
        got_cos, want_cos = (got * cos)[uniform], (want * cos)[uniform]
        log.append(np.mean(np.abs(np.log((got_cos + e) / (want_cos + e))), 0))
    table = np.array(energy)
    return {
        "energy_median": float(np.median(table)),
        "energy_mean": float(table.mean()),
        "energy_max": float(table.max()),
        "energy_worst_channel": float(table.mean(0).max()),
        "grazing": float(table[-1].mean()),
        "bright_min": float(np.min(bright)),
        "bright_max": float(np.max(bright)),
        "log": float(np.mean(log)),
    }
