"""materials: where they come from."""

from typing import Annotated

import typer

app = typer.Typer(help="List, find and fetch materials that a simulated rig can show.", rich_markup_mode=None)


@app.callback(invoke_without_command=True)
def main(context: typer.Context) -> None:
    if context.invoked_subcommand is None:
        from gonio.brdf.library import known

        for line in known():
            typer.echo(line)


@app.command()
def fetch(names: Annotated[list[str], typer.Argument(help="names in the RGL-EPFL material database, e.g. chm_orange")]) -> None:
    """Fetch measured RGL tables (CC0) into the user's cache."""
    from gonio.brdf.library import fetch as get

    for name in names:
        typer.echo(get(name))
