"""What the default reconstruction costs and what its table loses; anisotropic truths of known form.

Samples here are drawn by the truth itself, a quarter of them uniformly, with the sim rig's noise. CPU seconds of one
process; memory is the process's peak so far. "table": energy error of the tabulated BRDF against the splines it is
made of; "f cos / pdf": relative standard deviation of that weight at theta_i = 15 and 75 degrees, one sample each.
"""

import json
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.atomic import write_text
from gonio.bench.accuracy.reconstruction import Noise, noisy
from gonio.bench.drive import truth_of
from gonio.brdf import Beckmann, Brdf, Ggx, Lambert, Mixture
from gonio.config.loader import Section
from gonio.evaluate import directions, evaluate
from gonio.export.bsdf import write_bsdf
from gonio.geometry import from_angles, from_height
from gonio.reconstruct import Samples, reconstruct
from gonio.reconstruct.splines import auto
from gonio.reconstruct.tables.tabulate import TabulatedBrdf

RIG = Noise(relative=0.005, read=3.2e-5)
BRUSHED = {
    "GGX 0.3 / 0.03": Ggx(0.3, 0.03, weight=[0.5, 0.4, 0.3]),
    "GGX 0.4 / 0.1": Ggx(0.4, 0.1, weight=[0.5, 0.4, 0.3]),
    "Beckmann 0.03 / 0.3": Beckmann(0.03, 0.3, weight=[0.5, 0.4, 0.3]),
    "GGX 0.1, told anisotropic": Ggx(0.1, weight=[0.5, 0.4, 0.3]),
}
DIFFUSE = Lambert([0.05, 0.2, 0.4])


class Config(Section):
    """sizes: N of the first table, of `material`; the second is of `materials` at `samples`."""

    study: Literal["reconstruction_speed"]
    material: str
    sizes: tuple[int, ...] = (1000, 10_000, 100_000, 1_000_000)
    materials: tuple[str, ...] = ()
    samples: int = 10_000
    brushed: tuple[int, ...] = (2000, 10_000)
    pairs: int = 1_000_000
    seed: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    rows = [_size(config, n, say) for n in config.sizes]
    if config.materials:
        say(f"\n{'material':22}{'1e6 pairs/s':>12}{'table':>9}{'f cos/pdf 15':>14}{'75':>7}")
    rows += [_table(config, name, say) for name in config.materials]
    for name, lobe in BRUSHED.items():
        truth = Mixture([lobe, DIFFUSE])
        errors = [brushed_error(reconstruct(drawn(truth, n, 0), anisotropic=True), truth) for n in config.brushed]
        if errors:
            say(f"{name:28}" + "".join(f"{n:8}: {e:.4f}" for n, e in zip(config.brushed, errors)))
        rows.append({"brushed": name, "energy": errors})
    write_text(out / "rows.json", json.dumps(rows, indent=1))


def _size(config: Config, n: int, say: Callable[[str], None]) -> dict:
    truth = truth_of(config.material)
    s = drawn(truth, n, config.seed)
    began = time.process_time()
    brdf = reconstruct(s)
    made = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        write_bsdf(brdf, Path(folder) / "brdf.bsdf")
    seconds, export = made - began, time.process_time() - made
    error = evaluate(brdf, truth)["energy_mean"]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    say(
        f"{n:9} samples: {seconds:6.1f} s, .bsdf {export:.1f} s, at most {peak:.2f} GB so far, energy error {error:.4f}"
    )
    return {"n": n, "seconds": seconds, "export": export, "gigabytes": peak, "energy": error}


def _table(config: Config, name: str, say: Callable[[str], None]) -> dict:
    truth = truth_of(name)
    smooth = auto.splines(drawn(truth, config.samples, config.seed), anisotropic=False, rng=np.random.default_rng(0))
    table = TabulatedBrdf.of(smooth.frame, smooth.base, smooth.ratio, smooth.t0, smooth.log_ratio)
    wrong, total = 0.0, 0.0
    for wi, wo, weight, _ in directions(2000):
        a = smooth.frame.angles(wi, wo)
        exact = smooth.ratio.inverse(smooth.log_ratio(a), smooth.base(a))
        energy = (exact * weight[:, None]).sum(0)
        wrong += float((np.abs(table.eval(wi, wo) * wo[:, 2:] - exact) * weight[:, None]).sum(0).dot(1 / energy))
        total += len(energy)
    rng = np.random.default_rng(0)
    wi = from_height(rng.random(config.pairs), 2 * np.pi * rng.random(config.pairs))
    wo = from_height(rng.random(config.pairs), 2 * np.pi * rng.random(config.pairs))
    began = time.process_time()
    table.eval(wi, wo)
    rate = config.pairs / (time.process_time() - began) / 1e6
    spread = [weight_spread(table, theta) for theta in (15, 75)]
    say(f"{name:22}{rate:12.2f}{wrong / total:9.4f}{spread[0]:14.2f}{spread[1]:7.2f}")
    return {"material": name, "rate": rate, "table": wrong / total, "spread": spread}


def weight_spread(brdf: Brdf, theta_i: float, n: int = 20_000) -> float:
    """Relative standard deviation of the mean channel's f cos / pdf over draws at theta_i degrees."""
    wi = np.broadcast_to(from_angles(np.radians(theta_i), 0.0), (n, 3))
    wo, pdf = brdf.sample(wi, np.random.default_rng(0).random((n, 2)))
    lit = (pdf > 0) & (wo[:, 2] > 0)
    w = np.zeros(n)
    w[lit] = brdf.eval(wi[lit], wo[lit]).mean(1) * wo[lit, 2] / pdf[lit]
    return float(w.std() / w.mean())


def drawn(truth: Brdf, n: int, seed: int) -> Samples:
    """n pairs above the horizon, three quarters by the truth's own sampler, with the rig's noise."""
    rng, parts, have = np.random.default_rng(seed), [], 0
    while have < n:
        m = 2 * (n - have) + 100
        wi = from_height(rng.random(m), 2 * np.pi * rng.random(m))
        wo, _ = truth.sample(wi, rng.random((m, 2)))
        even = rng.random(m) < 0.25
        wo[even] = from_height(rng.random(m), 2 * np.pi * rng.random(m))[even]
        up = (wi[:, 2] > 1e-3) & (wo[:, 2] > 1e-3)
        parts.append((wi[up], wo[up]))
        have += int(up.sum())
    wi, wo = (np.concatenate(p)[:n] for p in zip(*parts))
    return noisy(wi, wo, truth.eval(wi, wo), RIG, seed)


def brushed_error(brdf: Brdf, truth: Brdf, n: int = 4000, seed: int = 5) -> float:
    """Energy error, mean over six incidences and all azimuths of wi, by draws of the truth and uniform ones."""
    rng = np.random.default_rng(seed)
    errors = []
    for theta in np.radians(np.linspace(5, 80, 6)):
        wi = from_angles(np.full(n, theta), 2 * np.pi * rng.random(n))
        wo, _ = truth.sample(wi, rng.random((n, 2)))
        wo[::4] = from_height(rng.random(len(wo[::4])), 2 * np.pi * rng.random(len(wo[::4])))
        up = wo[:, 2] > 1e-3
        wi, wo = wi[up], wo[up]
        weight = wo[:, 2:] / (0.75 * truth.pdf(wi, wo) + 0.25 / (2 * np.pi))[:, None]
        want = truth.eval(wi, wo)
        errors.append((np.abs(brdf.eval(wi, wo) - want) * weight).sum(0) / (want * weight).sum(0))
    return float(np.mean(errors))
