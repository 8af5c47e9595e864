"""bench: run-time-versus-error studies."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    app.command()(bench)


def bench(
    study: Annotated[str | None, typer.Argument(help="a study's YAML, or the name of one that ships")] = None,
    out: Annotated[Path | None, typer.Option(help="folder for tables and figures [default: runs/bench/...]")] = None,
    set_: Annotated[list[str], typer.Option("--set", metavar="KEY=VALUE", help="override any key")] = [],  # noqa: B006
    dask: Annotated[
        str | None, typer.Option(metavar="tcp://HOST:PORT", help="a Dask scheduler whose workers make the cells")
    ] = None,
) -> None:
    """Run a study and print its table; without a name, list those that ship."""
    from gonio.bench.runner import run_study
    from gonio.config.find import SHIPPED, find_config

    if study is None:
        for path in sorted((SHIPPED / "studies").glob("*.yaml")):
            first = path.read_text().splitlines()[0].lstrip("# ")
            typer.echo(f"{path.stem:18} {first}")
        return
    sets = [*set_, *([f"dask={dask}"] if dask else [])]
    where = run_study(find_config(study, "studies"), sets, out, lambda line: typer.echo(line))
    typer.echo(f"written to {where}")
