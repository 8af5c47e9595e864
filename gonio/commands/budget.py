"""budget: how uncertain a run's BRDF is, and why."""

from pathlib import Path
from typing import Annotated

import typer


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
        import json as js

        typer.echo(js.dumps(found))
        return
    from rich.console import Console
    from rich.table import Table

    places = list(found["relative"]["combined"])
    table = Table(title="relative standard uncertainty (k = 1), median, percent", title_justify="left")
    table.add_column("part")
    for place in places:
        table.add_column(place, justify="right")
    for part, values in found["relative"].items():
        table.add_row(
            part, *(f"{100 * values[p]:.3g}" if p in values else "" for p in places), end_section=part != "combined"
        )
    dhr = Table(title="reflectance (DHR), with u (k = 1)", title_justify="left")
    dhr.add_column("θi")
    dhr.add_column("by channel")
    for row in found["dhr"]:
        each = "  ".join(f"{v:.4f} ± {u:.4f}" for v, u in zip(row["value"], row["u"]))
        dhr.add_row(f"{row['theta_i_deg']:g}°", each)
    console = Console(width=None if Console().is_terminal else 120)
    console.print(table)
    console.print(dhr)
    for line in found["left_out"]:
        typer.echo(f"not in it  {line}")
