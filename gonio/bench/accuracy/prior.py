"""Makes the prior over materials that ships (gonio/reconstruct/prior/materials.npz).

    gonio bench prior                              what ships: networks of RGL and DTU materials, random lobes
    gonio bench prior --set networks=strange       no kin of the 12 measured tables: for figures on those
    GONIO_PRIOR=FILE gonio …                       uses it

Nothing of the networks of MERL, whose licence asks for its own, is in it.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.atomic import replacing
from gonio.bench.drive import truth_of
from gonio.bench.flows.pretrain import TABLES, names_of
from gonio.config.loader import Section
from gonio.geometry import Array, from_half_diff
from gonio.reconstruct.prior.materials import EPS, Materials, nodes


class Config(Section):
    """archive: the file of networks; lobes: how many random materials; components: how many are kept."""

    study: Literal["prior"]
    archive: str
    networks: Literal["all", "strange"] = "all"
    lobes: int = 1000
    components: int = 48
    seed: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    names = [n for n in names_of(config.archive) if not n.startswith("merl/")]
    if config.networks == "strange":
        names = [n for n in names if kin(n) not in {kin(t) for t in TABLES}]
    theta_h, theta_d, phi_d = nodes()
    wi, wo = from_half_diff(theta_h, 0 * theta_h, theta_d, phi_d)
    rows = []
    for name in names:
        rows += list(_logs(truth_of(f"{config.archive}:{name}").eval(wi, wo), wi, wo))
    say(f"{len(names)} networks: {', '.join(n.rpartition('/')[2] for n in names)}")
    rng = np.random.default_rng(config.seed)
    for _ in range(config.lobes):
        rows += list(_logs(random_material(rng)(theta_h, theta_d, wi, wo)[:, None], wi, wo))
    logs = np.array(rows)
    made = Materials.of(logs, config.components)
    gap = logs - made.mean
    gap -= (gap @ np.linalg.pinv(made.components)) @ made.components
    say(f"{len(logs)} materials and channels, {config.components} components leave {np.sqrt(np.mean(gap**2)):.3f} rms")
    path = out / "materials.npz"
    with replacing(path) as stream:
        np.savez_compressed(stream, allow_pickle=False, **made.to_arrays())
    say(f"{path}  {path.stat().st_size / 1e6:.2f} MB")


def kin(name: str) -> str:
    """The family of a material: `cc` of cc_ibiza_sunset, `acrylic` of acrylic_felt_purple."""
    return name.rpartition("/")[2].partition("_")[0]


def _logs(f: Array, wi: Array, wo: Array) -> Array:
    """ln(f cos cos / s + EPS) (C, n), s such that f is 1 in the mean of the nodes above the horizon."""
    cos = np.maximum(wi[:, 2], 0) * np.maximum(wo[:, 2], 0)
    scale = (f * cos[:, None]).mean(0) / cos.mean()
    return np.log(f.T * cos / np.maximum(scale, 1e-12)[:, None] + EPS)


def random_material(rng: np.random.Generator) -> Callable[[Array, Array, Array, Array], Array]:
    """f (n,) of theta_h, theta_d, wi, wo: a diffuse part that may rise towards grazing, a peak, a broader second one.

    Peaks are D = (g - 1) / (pi alpha^2 cos^4) (1 + tan^2 / alpha^2)^-g (Student's t in the slopes), Fresnel by Schlick.
    """
    alpha = np.exp(rng.uniform(np.log((0.002, 0.02)), np.log((0.8, 1.0))))
    tail = np.array([rng.uniform(1.2, 3.5), 2.0])
    f0 = np.minimum([np.exp(rng.normal(-2, 1)), rng.random()], 1)
    strength = np.exp(rng.normal((-1, -2.5), (1.2, 1.5)))
    diffuse, rise, fade = np.exp(rng.normal(-1.5, 1.2)), 2 * rng.random(), rng.random()

    def f(theta_h: Array, theta_d: Array, wi: Array, wo: Array) -> Array:
        ci, co = (np.maximum(w[:, 2], 1e-6) for w in (wi, wo))
        schlick = (1 - np.cos(theta_d)) ** 5
        t2, c4 = np.tan(np.minimum(theta_h, 1.57)) ** 2, np.maximum(np.cos(theta_h), 1e-3) ** 4
        out = diffuse / np.pi * (1 + rise * schlick)
        for a, g, zero, s in zip(alpha, tail, f0, strength):
            d = (g - 1) / (np.pi * a**2 * c4) * (1 + t2 / a**2) ** -g
            out = out + s * d * (zero + (1 - zero) * schlick) * (2 * co / (ci + co)) ** fade / (
                4 * np.maximum(np.cos(theta_d), 0.02) * co
            )
        return np.where((wi[:, 2] > 0) & (wo[:, 2] > 0), out, 0)

    return f
