"""materials: where they come from."""

from pathlib import Path
from typing import Annotated

import typer

from gonio.commands import as_json

app = typer.Typer(help="List, find and fetch materials that a simulated rig can show.", rich_markup_mode=None)


@app.callback(invoke_without_command=True)
def main(context: typer.Context, json: Annotated[bool, typer.Option("--json", help="print JSON")] = False) -> None:
    if context.invoked_subcommand is None:
        from gonio.brdf.library import available, fetchable

        here = [
            {"name": m.name, "origin": m.origin, "path": str(m.path), "note": _invalid(m.path)} for m in available()
        ]
        names = {m["name"] for m in here if m["origin"].startswith("measured")}
        more = [name for name in fetchable() if name not in names]
        if json:
            as_json.say({"materials": here, "fetchable": more})
            return
        for m in here:
            typer.echo(f"{m['name']:24} {m['origin']}{': ' if m['note'] else ''}{m['note']}")
        if more:
            typer.echo(f"\n`gonio materials fetch NAME` gets: {', '.join(more)}")


def _invalid(path: Path) -> str:
    """What a MERL table does not hold, in words; nothing of other files."""
    if path.suffix != ".binary":
        return ""
    from gonio.brdf import BrdfFileError
    from gonio.brdf.tables.merl import read_merl

    try:
        with open(path, "rb") as stream:
            invalid = int((read_merl(stream, str(path)) < 0).sum())
    except (OSError, BrdfFileError) as e:
        return str(e)
    return f"{invalid} entries not measured, filled from their neighbours" if invalid else ""


@app.command()
def fetch(
    names: Annotated[list[str], typer.Argument(help="names in the RGL-EPFL material database, e.g. chm_orange")],
    within: Annotated[float, typer.Option(help="seconds each may take")] = 600,
    missing: Annotated[
        bool, typer.Option("--missing", help="only those of which no measured table is at hand")
    ] = False,
) -> None:
    """Fetch measured RGL tables (CC0) into the user's cache."""
    from gonio.brdf.library import available
    from gonio.brdf.library import fetch as get

    here = {found.name for found in available() if found.origin.startswith("measured")} if missing else set()
    for name in names:
        if name not in here:
            typer.echo(f"{name}  {get(name, within=within).path}")
