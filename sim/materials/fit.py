"""Fit the materials that ship from the measured tables: `python -m sim.materials.fit FOLDER`, FOLDER with *_rgb.bsdf.

The roughnesses are searched by Nelder-Mead from several starts, the colours found inside by non-negative least
squares of f cos(theta_o), each direction weighted so that what is minimised is energy: quadrature weight over the mean
of the table's f cos and the fit's (over the table's alone, the fit comes out too dark).
"""

import sys
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.optimize import minimize, nnls

from gonio.atomic import write_text
from gonio.brdf import Ggx, RglBrdf
from gonio.brdf.models.fitted import SPLINES, FittedBrdf, basis
from gonio.evaluate import evaluate
from gonio.geometry import Array, from_angles, from_height, reflect, to_half_diff

MATERIALS = {
    "acrylic_felt_purple": "purple acrylic felt",
    "cc_ibiza_sunset": "colour-shifting film, matt",
    "aurora_white": "colour-shifting film, white satin",
    "chm_orange": "orange chrome film",
    "ilm_solo_m_68": "blue metallic film",
}
LOBES = 3
STARTS = np.geomspace(1.5e-3, 0.9, 6)
THETA_I = np.radians([3, 10, 20, 30, 40, 50, 60, 68, 75, 81])
ALPHAS = (0.003, 0.012, 0.05, 0.2)
PER_ANGLE = 500  # directions per density and incidence


def directions(rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """wi, wo (N, 3) and quadrature weights (N,): uniform and four lobes of half vectors at each incidence."""
    out = []
    for theta in THETA_I:
        wi = from_angles(theta, 0.0)
        z, phi = rng.random(PER_ANGLE), 2 * np.pi * rng.random(PER_ANGLE)
        parts = [from_height(z, phi)]
        for alpha in ALPHAS:
            u, phi = rng.random(PER_ANGLE), 2 * np.pi * rng.random(PER_ANGLE)
            h = from_angles(np.arctan(alpha * np.sqrt(u / (1 - u))), phi)
            parts.append(reflect(np.broadcast_to(wi, h.shape), h))
        wo = np.concatenate(parts)
        wo = wo[wo[:, 2] > 1e-3]
        h = (wo + wi) / np.linalg.norm(wo + wi, axis=1, keepdims=True)
        density = np.full(len(wo), 1 / (2 * np.pi))
        for alpha in ALPHAS:
            t2 = (1 - h[:, 2] ** 2) / h[:, 2] ** 2
            density += alpha**2 / (np.pi * h[:, 2] ** 3 * (alpha**2 + t2) ** 2) / (4 * h @ wi)
        out.append((np.broadcast_to(wi, wo.shape), wo, 1 / (density * PER_ANGLE)))
    return tuple(np.concatenate(column) for column in zip(*out))  # type: ignore[return-value]


def fit(table: RglBrdf) -> FittedBrdf:
    """The fit of least weighted square error among Nelder-Mead's results from the best starts."""
    wi, wo, quadrature = directions(np.random.default_rng(0))
    f_cos = table.eval(wi, wo) * wo[:, 2:]
    spline = basis(to_half_diff(wi, wo)[2])
    theta_i = np.arctan2(wi[:, 0], wi[:, 2])
    total = np.array([f_cos[theta_i == t].T @ quadrature[theta_i == t] for t in np.unique(theta_i)])
    albedo = total[np.searchsorted(np.unique(theta_i), theta_i)]
    floor = 0.01 * albedo / np.pi

    def solve(log_alpha: Array) -> tuple[float, FittedBrdf]:
        alpha = np.exp(np.clip(log_alpha, np.log(3e-4), np.log(1.5)))
        lobes = [np.ones(len(wi)) / np.pi] + [Ggx(a).eval(wi, wo)[:, 0] for a in alpha]
        columns = np.concatenate([spline * (lobe * wo[:, 2])[:, None] for lobe in lobes], axis=1)
        loss, colours = 0.0, []
        for c in range(3):
            expected = f_cos[:, c]
            for _ in range(2):
                weight = np.sqrt(quadrature / (expected + floor[:, c]) / albedo[:, c])
                x = nnls(columns * weight[:, None], f_cos[:, c] * weight)[0]
                expected = 0.5 * (f_cos[:, c] + columns @ x)
            colours.append(x)
            loss += float(np.sum(quadrature * np.abs(columns @ x - f_cos[:, c]) / albedo[:, c]))
        return loss, FittedBrdf(alpha, np.array(colours).T.reshape(1 + LOBES, SPLINES, 3))

    starts = sorted((np.log(s) for s in combinations(STARTS, LOBES)), key=lambda s: solve(np.array(s))[0])[:3]
    options = {"xatol": 1e-2, "fatol": 1e-7, "maxiter": 60}
    found = [minimize(lambda p: solve(p)[0], s, method="Nelder-Mead", options=options) for s in starts]
    return solve(min(found, key=lambda r: r.fun).x)[1]


def text(name: str, about: str, brdf: FittedBrdf, table: RglBrdf) -> str:
    """The YAML of a fit: what it is, how it was made, how good it is, its numbers to four digits."""
    brdf = FittedBrdf(_short(brdf.alpha), _short(brdf.colour))
    figures = evaluate(brdf, table)
    rows = [f"# {about}: a fit of ours, not the measured table; {brdf.alpha.size + brdf.colour.size} numbers"]
    rows += [f"name: {name}", "made_by: python -m sim.materials.fit (non-negative least squares in Nelder-Mead)"]
    rows += ["made_from: RGL material database, CC0; Dupuy and Jakob 2018, doi 10.1145/3272127.3275059"]
    rows += ["# against that table, by gonio.evaluate:", "figures:"]
    rows += [f"  {key}: {value:.4f}" for key, value in figures.items()]
    rows += [f"alpha: [{', '.join(f'{a:g}' for a in brdf.alpha)}]"]
    rows += [
        "# the diffuse part, then each lobe: rgb at the spline coefficients over theta_d in 0..90 degrees",
        "colour:",
    ]
    for part in brdf.colour:
        first = "  -"
        for rgb in part:
            rows += [f"{first} - [{', '.join(f'{v:g}' for v in rgb)}]"]
            first = "   "
    return "\n".join(rows) + "\n"


def _short(a: Array) -> Array:
    return np.array([float(f"{v:.4g}") for v in np.ravel(a)]).reshape(np.shape(a))


def main(folder: str) -> None:
    here = Path(__file__).parent
    for name, about in MATERIALS.items():
        table = RglBrdf.from_file(Path(folder) / f"{name}_rgb.bsdf")
        brdf = fit(table)
        write_text(here / f"{name}.yaml", text(name, about, brdf, table))
        print(name, *(f"{k} {v:.3f}" for k, v in evaluate(brdf, table).items()))


if __name__ == "__main__":
    main(sys.argv[1])
