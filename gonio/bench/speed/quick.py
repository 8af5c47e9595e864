"""A guard against slow changes: a few kernels, as ratios to a calibration loop run beside each.

    make bench-quick                                  compare with the reference that is committed
    gonio bench quick --set 'reference=FILE.json'     write one there where there is none

Warns of what takes half again as long as in the reference, and never fails: machines differ, ratios less so.
"""

import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np

from gonio.atomic import write_text
from gonio.bench.drive import surrogate
from gonio.bench.harness.results import say_table
from gonio.brdf import Ggx, Lambert
from gonio.brdf.models.mixture import Mixture
from gonio.config import Material, load_config
from gonio.config.find import SHIPPED, find_config
from gonio.config.loader import Section
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.geometry import from_height, to_half_diff
from gonio.mcmc import make_sampler
from gonio.reconstruct import Samples, reconstruct
from gonio.run.open_rig import open_rig

REFERENCE = SHIPPED / "studies" / "quick_reference.json"
TRUTH = Mixture([Lambert([0.2] * 3), Ggx(0.1, None, [0.5] * 3)])


class Config(Section):
    """rounds: each kernel is timed so often, its calibration beside it; the median of the ratios counts."""

    study: Literal["quick"]
    reference: str | None = None
    rounds: int = 5
    slower: float = 1.5


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    path = Path(config.reference) if config.reference else REFERENCE
    known: dict[str, float] = json.loads(path.read_text()) if path.exists() else {}
    ratios = {name: _ratio(make(), config.rounds) for name, make in KERNELS.items()}
    write_text(out / "ratios.json", json.dumps(ratios, indent=1))
    rows = [[name, r, known.get(name, float("nan")), r / known.get(name, float("nan"))] for name, r in ratios.items()]
    say_table(say, ["kernel", "ratio", "reference", "of it"], rows, "time over that of the calibration loop, medians")
    slow = [name for name, r in ratios.items() if name in known and r > config.slower * known[name]]
    for name in slow:
        say(f"WARNING: {name} takes {ratios[name] / known[name]:.2f} times as long as in {path.name}")
    if not known and config.reference:
        write_text(path, json.dumps(ratios, indent=1))
        say(f"reference written: {path}")
    elif not slow:
        say("nothing takes half again as long as in the reference" if known else f"no reference at {path}")


def _ratio(kernel: Callable[[], Any], rounds: int) -> float:
    kernel()
    found = []
    for _ in range(rounds):
        found.append(_seconds(kernel) / _seconds(calibration))
    return float(np.median(found))


def _seconds(do: Callable[[], Any]) -> float:
    began = time.process_time()
    do()
    return max(time.process_time() - began, 1e-9)


def calibration() -> None:
    """Some of everything that the kernels are made of: interpreter, array arithmetic, sorting, a small solve."""
    rng = np.random.default_rng(0)
    x = rng.random((200, 2000))
    for _ in range(10):
        x = np.sqrt(np.exp(-x) + x * x)
        np.sort(x[:20], axis=1)
    np.linalg.solve(x[:, :200] + 200 * np.eye(200), x[:, :50])
    sum(k * k % 7 for k in range(60_000))


def _pairs(count: int):
    rng = np.random.default_rng(1)
    return (from_height(0.05 + 0.95 * rng.random(count), 2 * np.pi * rng.random(count)) for _ in range(2))


def _samples(count: int) -> Samples:
    wi, wo = _pairs(count)
    return Samples.of(wi, wo, TRUTH.eval(wi, wo))


def _eval() -> Callable[[], Any]:
    wi, wo = _pairs(50_000)
    return lambda: TRUTH.eval(wi, wo)


def _angles() -> Callable[[], Any]:
    wi, wo = _pairs(50_000)
    return lambda: to_half_diff(wi, wo)


def _chain() -> Callable[[], Any]:
    material = Material.model_validate({"name": "x", "budget": {"measurements": 200}})

    def do() -> None:
        sampler = make_sampler(material, None, surrogate, (200,))
        made = 0
        while made < 200:
            batch = sampler.ask()
            sampler.tell(batch.ids, TRUTH.eval(batch.wi, batch.wo))
            made += len(batch.ids)

    return do


def _running() -> Callable[[], Any]:
    s = _samples(500)
    return lambda: surrogate(s.wi, s.wo, s.f)


def _reconstruction() -> Callable[[], Any]:
    s = _samples(500)
    return lambda: reconstruct(s)


def _lookup() -> Callable[[], Any]:
    brdf, (wi, wo) = reconstruct(_samples(300)), _pairs(50_000)
    return lambda: brdf.eval(wi, wo)


def _tour() -> Callable[[], Any]:
    rig = load_config(find_config("sim", "rigs"), RigConfig)
    wi, wo = _pairs(400)

    def do() -> None:
        opened = open_rig(rig, TRUTH, 1, plan=PlanConfig(), isotropic=True)
        keep = np.flatnonzero(opened.reachable(wi, wo))[:150]
        list(opened.visit(wi[keep], wo[keep], np.arange(len(keep))))

    return do


KERNELS: dict[str, Callable[[], Callable[[], Any]]] = {
    "Brdf.eval, 50,000 pairs": _eval,
    "to_half_diff, 50,000 pairs": _angles,
    "running reconstruction, 500 samples": _running,
    "reconstruction, 500 samples": _reconstruction,
    "lookup, 50,000 pairs": _lookup,
    "chain, 200 measurements": _chain,
    "tour of 150 on sim": _tour,
}
