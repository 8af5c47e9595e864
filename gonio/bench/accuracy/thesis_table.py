"""The thesis method on the measured tables, beside what METHOD says of it: the baseline of every comparison.

Simple PSS (sigma 0.05, 10 % global, all coordinates wrapped) on channel 0, no noise; `thesis` reconstruction;
energy error and brightness as the referee defines them, the energy's median over angles and channels.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Literal

import numpy as np

from gonio.bench.drive import drive, truth_of
from gonio.config.loader import Section
from gonio.config.material import THESIS
from gonio.evaluate import evaluate
from gonio.reconstruct import Samples, reconstruct


class Config(Section):
    """expected: material -> N -> energy error in METHOD's table; each is the mean over `seeds`."""

    study: Literal["thesis"]
    expected: dict[str, dict[int, float]]
    model: str = "thesis"
    seeds: tuple[int, ...] = (1, 2, 3)


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    say(f"{'material':22}{'N':>7}{'energy':>9}{'METHOD':>9}{'ratio':>7}{'mean':>9}  brightness")
    section = dict(THESIS)
    for material, rows in config.expected.items():
        brdf = truth_of(material)
        runs = [drive(brdf, section, max(rows), seed=seed) for seed in config.seeds]
        for n, expected in rows.items():
            made = (reconstruct(Samples.of(d.wi[:n], d.wo[:n], d.f[:n]), config.model) for d in runs)
            figures = [evaluate(made_brdf, brdf) for made_brdf in made]
            names = ("energy_median", "energy_mean", "bright_min", "bright_max")
            median, mean, low, high = (float(np.mean([f[k] for f in figures])) for k in names)
            numbers = f"{median:9.4f}{expected:9.3f}{median / expected:7.2f}{mean:9.4f}"
            say(f"{material:22}{n:7}{numbers}  {low:.2f} … {high:.2f}")
