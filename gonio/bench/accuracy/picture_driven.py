"""What a measurement for one picture saves: scene by scene, beside the same rig measuring for every direction.

    gonio bench scene

A cell records the scene, measures a material by `sampler.target.scene` or plainly, and renders the scene with truth and
reconstruction by the same paths, so that their noise is nearly the same. Written down: FLIP and relMSE (the squares of
two renders with other paths multiplied, so that noise is not in it), the error that `gonio.picture` speaks of, and, for
those measured for the picture, the figures of the same scene from another camera.
"""

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from gonio.bench.accuracy.peer_tables import of, reached
from gonio.bench.drive import truth_of
from gonio.bench.harness import Cell, Row, run_cells
from gonio.bench.harness.results import geometric, say_table, write_parquet
from gonio.bench.peers.ours import by_sampler
from gonio.bench.peers.session import Session
from gonio.config import load_config
from gonio.config.find import find_config
from gonio.config.loader import Section
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.evaluate import evaluate
from gonio.export.bsdf import write_bsdf
from gonio.geometry import Array
from gonio.reconstruct import reconstruct
from gonio.render.metrics import compare
from gonio.render.scene.files import find_scene, put, read_scene
from gonio.render.scene.record import Recorded, load, record

WAYS = ("plain", "picture")
FIGURES = {"relmse": "relMSE", "flip": "FLIP", "error": "light in the wrong place"}


class Config(Section):
    """scenes, materials: names. spp: of the two renders of a cell that are compared; turn: by how many degrees the new
    camera goes round the scene's middle."""

    study: Literal["scene"]
    scenes: tuple[str, ...] = ("sky", "panel", "interior")
    materials: tuple[str, ...]
    measurements: tuple[int, ...] = (50, 100, 200, 400, 800, 1600)
    seeds: int = 1
    rig: str = "sim"
    spp: int = 64
    turn: float = 50.0
    workers: int = 2
    dask: str | None = None


def run(config: Config, out: Path, say: Callable[[str], None]) -> None:
    cells: list[Cell] = [
        {"scene": s, "material": m, "way": w, "n": n, "seed": k,
         "rig": config.rig, "spp": config.spp, "turn": config.turn}
        for n in config.measurements for s in config.scenes for m in config.materials for w in WAYS
        for k in range(1, config.seeds + 1)
    ]  # fmt: skip
    rows: list[Row] = []
    try:
        for _, found in run_cells(f"{__name__}:cell", cells, out, workers=config.workers, dask=config.dask):
            rows += found
    finally:
        good = [r for r in rows if "relmse" in r]
        if good:
            write_parquet(out / "results.parquet", rows, config)
            _tables(good, say)


def cell(c: dict[str, Any]) -> list[Row]:
    truth = truth_of(c["material"])
    with TemporaryDirectory() as scratch:
        seen = _recorded(c["scene"])
        asked = Path(scratch) / "scene.npz"
        seen.picture.save(asked)
        rig = load_config(find_config(c["rig"], "rigs"), RigConfig)
        session = Session(c["material"], truth, rig, c["seed"], PlanConfig())
        by_sampler(session, c["n"], {"target": {"scene": str(asked)}} if c["way"] == "picture" else {})
        brdf = reconstruct(session.samples)
        row: Row = {
            "measured": session.measured,
            "rig_s": session.rig_s,
            "energy": evaluate(brdf, truth)["energy_mean"],
        }
        p = seen.picture
        f = truth.eval(p.wi, p.wo)
        row["error"] = p.error(np.abs(brdf.eval(p.wi, p.wo) - f), f)
        files = {}
        for name, one in (("truth", truth), ("ours", brdf)):
            files[name] = str(Path(scratch) / f"{name}.bsdf")
            write_bsdf(one, files[name])
        for prefix, turn in (("", 0.0), ("new_", c["turn"])):
            row |= {prefix + k: v for k, v in _figures(c["scene"], files, c["spp"], turn).items()}
    return [row]


@lru_cache(maxsize=3)
def _recorded(scene: str) -> Recorded:
    return record(find_scene(scene), "measured")


def _figures(scene: str, files: dict[str, str], spp: int, turn: float) -> dict[str, float]:
    """FLIP of two renders by the same paths; relMSE of the product of the differences by two sets of paths."""
    images = {(name, seed): show(scene, file, spp, seed, turn) for name, file in files.items() for seed in (1, 2)}
    mean = {name: (images[name, 1] + images[name, 2]) / 2 for name in files}
    apart = [images["ours", seed] - images["truth", seed] for seed in (1, 2)]
    relmse = float(np.mean(apart[0] * apart[1] / (mean["truth"] ** 2 + 1e-2)))
    return {"relmse": max(relmse, 1e-9), "flip": compare(mean["ours"], mean["truth"])["FLIP"]}


def show(scene: str, material: str, spp: int, seed: int, turn: float = 0.0) -> Array:
    """A scene with a .bsdf file for the material, (H, W, 3), linear; the camera `turn` degrees round the vertical."""
    path = find_scene(scene)
    root = read_scene(path)
    if turn:
        for to_world in root.iterfind("sensor/transform"):
            axis = {"x": "0", "y": "0", "z": "1", "angle": f"{turn:g}"}
            to_world.append(to_world.makeelement("rotate", axis))
    loaded = load(put(root, "measured", path, material), path)
    from gonio.render.mitsuba import load_mitsuba

    return np.array(load_mitsuba().render(loaded, spp=spp, seed=seed))[..., :3]


def _tables(rows: list[Row], say: Callable[[str], None]) -> None:
    scenes, budgets = list(dict.fromkeys(r["scene"] for r in rows)), sorted({r["n"] for r in rows})
    mean = lambda some, key: geometric([r[key] for r in some]) if some else float("nan")
    for key, name in FIGURES.items():
        table = []
        for scene in scenes:
            for way in WAYS:
                table.append([scene, way, *(mean(of(rows, scene=scene, way=way, n=n), key) for n in budgets)])
        say_table(say, ["scene", "measured for", *(f"N = {n}" for n in budgets)], table, f"{name}, geometric mean")
    table = []
    for scene in scenes:
        line: list = [scene]
        for key in FIGURES:
            line.append(geometric(_savings(of(rows, scene=scene), key)))
        new = [_pair(rows, scene, n, "new_relmse") for n in budgets]
        line.append(float(np.sqrt(geometric([v for v in new if np.isfinite(v)]))))
        energy = [_pair(rows, scene, n, "energy") for n in budgets]
        line.append(geometric([v for v in energy if np.isfinite(v)]))
        table.append(line)
    head = ["scene", *(f"1 : by {v}" for v in FIGURES.values()), "new camera", "all directions"]
    say_table(say, head, table, "measurements for the picture : plain, to what plain reaches with the middle budget; "
              "root relMSE from a new camera, and energy error, picture : plain")  # fmt: skip


def _savings(rows: list[Row], key: str) -> list[float]:
    """Of each material, plain's measurements over the picture's for the figure that plain has at its middle budget."""
    out = []
    for material in dict.fromkeys(r["material"] for r in rows):
        mine = of(rows, material=material)
        budgets = sorted({r["n"] for r in mine})
        if len(budgets) < 3:
            continue
        at = budgets[(len(budgets) + 1) // 2]
        goal = geometric([r[key] for r in of(mine, way="plain", n=at)])
        needed = reached([{**r, "energy": r[key]} for r in of(mine, way="picture")], goal, "measured")
        if needed:
            out.append(at / needed)
    return out


def _pair(rows: list[Row], scene: str, n: int, key: str) -> float:
    ours, plain = (of(rows, scene=scene, way=w, n=n) for w in ("picture", "plain"))
    return geometric([r[key] for r in ours]) / geometric([r[key] for r in plain]) if ours and plain else float("nan")
