"""Pretraining of the flows that ship: the zoo of GGX roughnesses, and one conditional flow over many materials.

    gonio bench pretrain                  what ships: RGL tables, networks of RGL materials, random lobes
    gonio bench pretrain --set networks=all --set 'tables=[]' --set 'zoo=[]'       every network but those kept
    gonio bench pretrain --set networks=strange --set 'tables=[]' --set 'zoo=[]'   nothing of the 12 measured tables

The draws are of the sampler's default target (largest channel over its albedo, a tenth of the draws from the floor).
"""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.atomic import replacing
from gonio.bench.drive import truth_of
from gonio.brdf import Brdf
from gonio.brdf.models.lambert import Lambert
from gonio.brdf.models.microfacet import Beckmann, Ggx
from gonio.brdf.models.mixture import Mixture
from gonio.config.loader import Section
from gonio.config.material import SamplerConfig
from gonio.flow.cubes import make_cube
from gonio.flow.flow import Flow, Shape
from gonio.flow.pool import resampled, weighted
from gonio.geometry import Array
from gonio.mcmc.plans import make_target

KEPT = 20  # networks for validation


class Config(Section):
    """networks `rgl`: those of RGL materials; `all`: of every source; `strange`: of no material that has a table.

    Those kept for validation are in none. tables, zoo: names and roughnesses.
    """

    study: Literal["pretrain"]
    archive: str
    networks: Literal["rgl", "all", "strange", "none"] = "rgl"
    tables: tuple[str, ...] = ()
    zoo: tuple[float, ...] = ()
    lobes: int = 150
    blends: int = 60
    pool: int = 12_000
    even: int = 150_000
    steps: int = 6000
    batch: int = 1024
    rate: float = 2e-3
    hidden: int = 96
    bins: int = 24
    couplings: int = 4
    code: int = 8
    encoding: str = "one_blob"
    warp: str = "quadratic"
    seed: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    rng = np.random.default_rng(config.seed)
    if config.zoo:
        _zoo(config, out, say, rng)
    names = list(config.tables)
    names += [f"{config.archive}:{n}" for n in networks(config)]
    pools = [pool(truth_of(n), config, rng) for n in names]
    say(f"{len(names)} materials drawn from")
    pools += [pool(random_lobes(rng), config, rng) for _ in range(config.lobes)]
    for _ in range(config.blends):
        i, j = rng.choice(len(pools), 2, replace=False)
        share = rng.random()
        take = rng.random(config.pool) < share
        pools.append(np.where(take[:, None], pools[i], pools[j]))
    say(f"{len(pools)} with lobes and blends")
    from gonio.flow.train import train

    x, material = np.concatenate(pools), np.repeat(np.arange(len(pools)), [len(p) for p in pools])
    flow = Flow.fresh(shape(config, config.code), rng)
    codes = 0.1 * rng.standard_normal((len(pools), config.code))
    done = train(
        flow, x, material=material, codes=codes, steps=config.steps, batch=config.batch, rate=config.rate, rng=rng
    )
    say("mean loss by tenths: " + " ".join(f"{v:.3f}" for v in done.losses))
    own = done.codes[: len(pools) - config.blends]
    save(out / "code.npz", done.flow.to_arrays() | {"codes": own.astype(np.float32)})


def _zoo(config: Config, out: Path, say: Callable[[str], None], rng: np.random.Generator) -> None:
    from gonio.flow.train import train

    for alpha in config.zoo:
        x = pool(Mixture([Lambert([0.05]), Ggx(alpha, None, [0.5])]), config, rng)
        small = config.model_copy(update={"hidden": config.hidden // 2})
        done = train(
            Flow.fresh(shape(small, 0), rng), x, steps=config.steps // 8, batch=config.batch, rate=config.rate, rng=rng
        )
        say(f"alpha {alpha:g}: mean loss by tenths " + " ".join(f"{v:.3f}" for v in done.losses))
        save(out / f"ggx_{alpha:g}.npz", done.flow.to_arrays())


def shape(config: Config, code: int) -> Shape:
    network = {"couplings": config.couplings, "bins": config.bins, "hidden": config.hidden}
    return Shape.of(make_cube("half", 0.1), warp=config.warp, encoding=config.encoding, code=code, **network)


def save(path: Path, arrays: dict[str, Array]) -> None:
    """Weights as float16: what ships is what was rounded."""
    small = {k: (v.astype(np.float16) if k.startswith("weight.") else v) for k, v in arrays.items()}
    with replacing(path) as stream:
        np.savez_compressed(stream, allow_pickle=False, **small)


def pool(brdf: Brdf, config: Config, rng: np.random.Generator) -> Array:
    """Points (config.pool, 3) of the half cube that follow the default target of `brdf`."""
    cube = make_cube("half", 0.1)
    x, log_w = weighted(cube, target_of(brdf, rng), config.even, rng)
    return resampled(x, log_w, config.pool, rng)


def target_of(brdf: Brdf, rng: np.random.Generator) -> Callable[[Array, Array], Array]:
    """log of a flow's default target of a BRDF, its albedos and floor set by even draws."""
    target = make_target(SamplerConfig(proposal="flow"), brdf.channels)
    cube = make_cube("half", 0.1)
    x = rng.random((40_000, 3))
    wi, wo = cube.to_directions(x)
    target.rescale(brdf.eval(wi, wo), wo[:, 2], -cube.log_jacobian(x, wi, wo) - np.log(4 * np.pi))
    return lambda wi, wo: target.log_prob(brdf.eval(wi, wo), wi, wo)


def random_lobes(rng: np.random.Generator) -> Brdf:
    """Lambert and one to three GGX or Beckmann lobes, grey; roughness log-even from 0.002 to 0.6."""
    parts: list[Brdf] = [Lambert([float(10 ** rng.uniform(-2.5, 0))])]
    for _ in range(rng.integers(1, 4)):
        lobe = Ggx if rng.random() < 0.7 else Beckmann
        alpha = float(np.exp(rng.uniform(np.log(0.002), np.log(0.6))))
        parts.append(lobe(alpha, None, [float(rng.choice([rng.uniform(0.02, 0.1), rng.uniform(0.1, 1)]))],
                          weight=float(10 ** rng.uniform(-1, 0))))  # fmt: skip
    return Mixture(parts)


def networks(config: Config) -> list[str]:
    """Names of the networks to be trained on."""
    if config.networks == "none":
        return []
    kept = set(validation(config.archive))
    names = [n for n in names_of(config.archive) if n not in kept]
    if config.networks == "all":
        return names
    return [n for n in names if (n.startswith("rgl") if config.networks == "rgl" else n.split("/")[1] not in TABLES)]


def names_of(archive: str) -> list[str]:
    with np.load(archive, allow_pickle=False) as d:
        return [str(n) for n in d["names"]]


def validation(archive: str) -> list[str]:
    """The networks kept: evenly spaced among those whose material is not also one of the 12 measured tables."""
    names = [n for n in names_of(archive) if n.split("/")[1] not in TABLES]
    return [names[int((k + 0.5) * len(names) / KEPT)] for k in range(KEPT)]


TABLES = tuple(
    f"{n}_rgb"
    for n in (
        "acrylic_felt_purple", "paper_white", "cardboard", "cm_toxic_green", "aurora_white", "satin_rosaline",
        "vch_silk_blue", "cc_ibiza_sunset", "irid_flake_paint1", "ilm_solo_m_68", "chm_orange", "cg_sunflower",
    )
)  # fmt: skip
