"""Studies by name: `gonio bench STUDY` reads configs/studies/STUDY.yaml and runs the module its `study` key names."""

import os
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import yaml

from gonio.atomic import write_text
from gonio.config import ConfigError, load_config

# each module has `Config` (a Section with a field `study`) and `run(config, out, say)`
STUDIES = {
    "convergence": "gonio.bench.chains.convergence",
    "sampling": "gonio.bench.chains.effective_samples",
    "throughput": "gonio.bench.speed.throughput",
    "reconstruction": "gonio.bench.accuracy.reconstruction",
    "where_to_look": "gonio.bench.accuracy.where_to_look",
    "thesis": "gonio.bench.accuracy.thesis_table",
    "rendered": "gonio.bench.accuracy.rendered",
    "reconstruction_speed": "gonio.bench.speed.reconstruction_speed",
    "ablations": "gonio.bench.accuracy.ablations",
    "rig": "gonio.bench.speed.rig_seconds",
    "wire": "gonio.bench.speed.wire",
    "picture": "gonio.bench.accuracy.picture",
    "flow": "gonio.bench.flows.flow",
    "flow_speed": "gonio.bench.flows.flow_speed",
    "codes": "gonio.bench.flows.codes",
    "pretrain": "gonio.bench.flows.pretrain",
    "coverage": "gonio.bench.accuracy.coverage",
    "accuracy": "gonio.bench.accuracy.peers",
    "scene": "gonio.bench.accuracy.picture_driven",
    "side_by_side": "gonio.bench.accuracy.side_by_side",
    "stability": "gonio.bench.stability.study",
    "skips": "gonio.bench.accuracy.skips",
    "growth": "gonio.bench.speed.growth",
    "quick": "gonio.bench.speed.quick",
    "prior": "gonio.bench.accuracy.prior",
}


def run_study(path: Path, overrides: list[str], out: Path | None, say: Callable[[str], None]) -> Path:
    """Run the study of a YAML file; its tables and figures go to `out` (runs/bench/<name>-<stamp>), returned."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    try:
        kind = (yaml.safe_load(path.read_text()) or {}).get("study")
    except (OSError, yaml.YAMLError, AttributeError) as e:
        raise ConfigError(f"{path}: cannot be read as a study ({e})".replace("\n", " ")) from None
    if kind not in STUDIES:
        raise ConfigError(f"{path}: study: {kind!r} is not one of {', '.join(STUDIES)}")
    module = import_module(STUDIES[kind])
    config = load_config(path, module.Config, overrides)
    out = out or Path("runs") / "bench" / f"{path.stem}-{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}"
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as e:
        raise ConfigError(f"{out}: {e.strerror}; name another folder with --out") from None
    table: list[str] = []

    def both(line: str) -> None:
        say(line)
        table.append(line)
        write_text(out / "table.txt", "\n".join([*table, ""]))  # so far, and whole at every moment

    module.run(config, out, both)
    return out
