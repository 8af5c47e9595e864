"""What each part of the default reconstruction is worth: the same samples with one of its constants set otherwise."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Literal

import numpy as np

from gonio.atomic import write_text
from gonio.bench.accuracy.reconstruction import Noise, noisy
from gonio.bench.drive import drive, truth_of
from gonio.config.loader import Section
from gonio.evaluate import evaluate
from gonio.reconstruct import reconstruct


class Config(Section):
    """variants: name -> {module of gonio.reconstruct.CONSTANT: value}."""

    study: Literal["ablations"]
    materials: tuple[str, ...]
    variants: dict[str, dict[str, float]]
    sampler: dict | str
    chains: int = 4
    measurements: tuple[int, ...] = (1000, 10_000)
    noise: Noise = Noise(relative=0.005, read=3.2e-5)
    seed: int = 1


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    variants: dict[str, dict[str, float]] = {"as it is": {}} | config.variants
    say(f"{'material':22}{'N':>7}" + "".join(f"{name:>18}" for name in variants))
    errors: dict[int, list[list[float]]] = {n: [] for n in config.measurements}
    for material in config.materials:
        truth = truth_of(material)
        d = drive(truth, config.sampler, max(config.measurements), chains=config.chains, seed=config.seed)
        s = noisy(d.wi, d.wo, d.f, config.noise, config.seed)
        for n in config.measurements:
            row = []
            for constants in variants.values():
                with changed(constants):
                    row.append(evaluate(reconstruct(s[:n]), truth)["energy_mean"])
            errors[n].append(row)
            say(f"{material[-21:]:22}{n:7}" + "".join(f"{e:18.4f}" for e in row))
        write_text(out / "errors.json", json.dumps({"variants": list(variants), "errors": errors}))
    for n in config.measurements:
        say(f"{'mean':22}{n:7}" + "".join(f"{e:18.4f}" for e in np.mean(errors[n], 0)))


@contextmanager
def changed(constants: dict[str, float]) -> Iterator[None]:
    """Constants of modules of gonio.reconstruct.splines, `stretch.RATIO`, set for a while."""
    places: list[tuple[ModuleType, str, float]] = []
    for key, value in constants.items():
        file, _, name = key.partition(".")
        places.append((import_module(f"gonio.reconstruct.splines.{file}"), name, value))
    before = [getattr(module, name) for module, name, _ in places]
    try:
        for module, name, value in places:
            setattr(module, name, value)
        yield
    finally:
        for (module, name, _), value in zip(places, before):
            setattr(module, name, value)
