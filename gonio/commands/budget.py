"""budget: how uncertain a run's BRDF is, and why."""

from pathlib import Path
from typing import Annotated

import typer

from gonio.commands import as_json


def register(app: typer.Typer) -> None:
    app.command()(budget)


def budget(
    run: Annotated[Path, typer.Argument(help="a run folder")],
    theta_i: Annotated[
        list[float] | None,
        typer.Option(min=0, max=85, help="degrees at which to give the reflectance (DHR); once each"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """The uncertainty of a run's BRDF by part and place, and of its reflectance (GUM; k = 1); kept as budget.json."""
    from gonio.run.products import make_budget

    found = make_budget(run, None if not theta_i else tuple(theta_i))
    if json:
        as_json.say(found)
        return
    from rich.console import Console
    from rich.table import Table

    places = list(found["relative"]["combined"])
    table = _table("relative standard uncertainty (k = 1), median, percent", found["relative"], places)
    angles = _table("angles, of that", found["of_angles"], places)
    readings = _table("of one reading: the random parts in reconstruction", found["of_each_reading"], places)
    dhr = Table(title="reflectance (DHR), with u (k = 1)", title_justify="left")
    dhr.add_column("θi")
    dhr.add_column("by channel")
    for row in found["dhr"]:
        each = "  ".join(f"{v:.4f} ± {'?' if u is None else f'{u:.4f}'}" for v, u in zip(row["value"], row["u"]))
        dhr.add_row(f"{row['theta_i_deg']:g}°", each)
    console = Console(width=None if Console().is_terminal else 120)
    for shown in (table, angles, readings, dhr):
        if shown.row_count:
            console.print(shown)
    for line in found["left_out"]:
        typer.echo(f"not in it  {line}")


def _table(title: str, values: dict[str, dict[str, float]], places: list[str]):
    from rich.table import Table

    table = Table(title=title, title_justify="left")
    table.add_column("part")
    for place in places:
        table.add_column(place, justify="right")
    for part, row in values.items():
        table.add_row(part, *(f"{100 * row[p]:.3g}" if p in row else "" for p in places))
    return table
