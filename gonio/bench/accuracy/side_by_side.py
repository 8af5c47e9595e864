"""A picture of what the same rig time makes of a material, way by way: a scene rendered with truth and each of them.

    gonio bench side_by_side

Every way has as many measurements as fit into `rig_s` seconds of the same rig; its number is found by its own pace.
"""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from gonio.atomic import beside
from gonio.bench.accuracy.picture_driven import show
from gonio.bench.drive import truth_of
from gonio.bench.harness.results import say_table
from gonio.bench.peers import PEERS, peer
from gonio.bench.peers.ours import by_sampler
from gonio.bench.peers.session import Session
from gonio.brdf import Brdf
from gonio.config import ConfigError, load_config
from gonio.config.find import find_config
from gonio.config.loader import Section
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.evaluate import evaluate
from gonio.export.bsdf import write_bsdf
from gonio.reconstruct import reconstruct
from gonio.render.metrics import compare
from gonio.render.scene.files import find_scene
from gonio.render.scene.record import record
from gonio.render.shade import to_srgb

FOR_IT = "ours, for this picture"


class Config(Section):
    """ways: of gonio.bench.peers, and `ours, for this picture`."""

    study: Literal["side_by_side"]
    scene: str = "panel"
    material: str = "cc_ibiza_sunset"
    rig: str = "sim"
    rig_s: float = 60.0
    ways: tuple[str, ...] = (FOR_IT, "ours", "ggx importance", "sobol list", "chain of before")
    spp: int = 256


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    if unknown := set(config.ways) - {*PEERS, FOR_IT}:
        raise ConfigError(f"ways: {', '.join(sorted(unknown))} is not one of {', '.join((FOR_IT, *PEERS))}")
    truth = truth_of(config.material)
    with TemporaryDirectory() as scratch:
        asked = Path(scratch) / "scene.npz"
        record(find_scene(config.scene), "measured").picture.save(asked)
        images = {"truth": _shown(config, truth, Path(scratch) / "truth.bsdf")}
        titles, rows = {"truth": config.material}, []
        for way in config.ways:
            session = _measured(config, way, truth, asked)
            brdf = reconstruct(session.samples)
            images[way] = _shown(config, brdf, Path(scratch) / "ours.bsdf")
            found = compare(images[way], images["truth"])
            energy = evaluate(brdf, truth)["energy_mean"]
            rows.append([way, session.measured, session.rig_s, energy, found["FLIP"], found["relMSE"]])
            titles[way] = f"{way}\n{session.measured} in {session.rig_s:.0f} rig s, FLIP {found['FLIP']:.3f}"
    say_table(say, ["way", "measured", "rig s", "energy error", "FLIP", "relMSE"], rows,
              f"{config.scene}, {config.material}, {config.rig_s:g} rig seconds each")  # fmt: skip
    _draw(images, titles, out / "side_by_side.png")


def _measured(config: Config, way: str, truth: Brdf, asked: Path) -> Session:
    """A session of about config.rig_s seconds: its number is corrected twice by its own pace."""
    rig = load_config(find_config(config.rig, "rigs"), RigConfig)
    n = max(20, round(config.rig_s / 0.7))
    for _ in range(3):
        session = Session(config.material, truth, rig, 1, PlanConfig())
        if way == FOR_IT:
            by_sampler(session, n, {"target": {"scene": str(asked)}})
        else:
            peer(way).look(session, n, np.random.default_rng(1))
        n = max(20, round(n * config.rig_s / session.rig_s))
    return session


def _shown(config: Config, brdf: Brdf, path: Path) -> np.ndarray:
    write_bsdf(brdf, path)
    return show(config.scene, str(path), config.spp, 1)


def _draw(images: dict[str, np.ndarray], titles: dict[str, str], path: Path) -> None:
    """Each beside the truth, and below it the difference, five times."""
    from matplotlib.figure import Figure

    height, width = images["truth"].shape[:2]
    figure = Figure(figsize=(2.9 * len(images), 5.6 * height / width + 0.9), layout="constrained")
    axes = figure.subplots(2, len(images), squeeze=False)
    for (name, image), (upper, lower) in zip(images.items(), axes.T):
        upper.imshow(to_srgb(image))
        upper.set_title(titles[name], fontsize=8)
        lower.imshow(to_srgb(np.clip(5 * np.abs(image - images["truth"]), 0, 1)))
        for each in (upper, lower):
            each.set_axis_off()
    axes[1][0].set_title("difference, five times", fontsize=8)
    with beside(path) as part:
        figure.savefig(part, format="png", dpi=120)
