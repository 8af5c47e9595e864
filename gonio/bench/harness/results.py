"""What a study found: one Parquet file with its provenance, tables on the terminal."""

import io
import json
import platform
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import gonio
from gonio.atomic import beside
from gonio.bench.harness.cells import Row, source_sha256
from gonio.config import ConfigError


def write_parquet(path: Path, rows: Sequence[Row], config: Any) -> None:
    """All rows, one column for each key; its metadata says by what config and code, and when. Raises ConfigError."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ModuleNotFoundError:
        raise ConfigError("results go into Parquet: pip install 'gonio[study]'") from None
    names = list(dict.fromkeys(k for r in rows for k in r))
    columns = {n: _column([r.get(n) for r in rows]) for n in names}
    origin = {
        "gonio": gonio.__version__,
        "source_sha256": source_sha256(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "host": platform.node(),
        "config": json.loads(config.model_dump_json()),
        "written": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }
    table = pa.table(columns).replace_schema_metadata({"gonio": json.dumps(origin)})
    with beside(path) as part:
        parquet.write_table(table, part)


def _column(values: list) -> list:
    """Of one type, as a column has to be: numbers, or text where one is not."""
    if all(v is None or isinstance(v, bool) for v in values):
        return values
    if all(v is None or isinstance(v, int | float) for v in values):
        return [None if v is None else float(v) for v in values]
    return [None if v is None else v if isinstance(v, str) else json.dumps(v) for v in values]


def say_table(say: Callable[[str], None], head: Sequence[str], rows: Sequence[Sequence[Any]], title: str = "") -> None:
    """A table of text: numbers on the right, four digits."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    if title:
        say("")
        say(title)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    numbers = [all(isinstance(r[k], int | float) or r[k] in ("", "–") for r in rows) for k in range(len(head))]
    for name, number in zip(head, numbers):
        table.add_column(name, justify="right" if number else "left", no_wrap=True)
    for row in rows:
        table.add_row(*(_text(v) for v in row))
    stream = io.StringIO()
    Console(file=stream, width=200, no_color=True).print(table)
    for line in stream.getvalue().rstrip().splitlines():
        say(line.rstrip())


def _text(v: Any) -> str:
    if isinstance(v, float):
        return "–" if not np.isfinite(v) else f"{v:.4g}" if abs(v) < 1e4 else f"{v:,.0f}"
    return str(v)


def geometric(values: Sequence[float]) -> float:
    """The geometric mean; NaN of nothing."""
    v = np.asarray(values, float)
    return float(np.exp(np.log(v).mean())) if len(v) else np.nan
