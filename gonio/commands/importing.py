"""import: readings made elsewhere become a run."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    app.command("import")(import_)


def import_(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="readings; of pab several, or their folder")],
    out: Annotated[Path | None, typer.Option(help="the run folder to make [default: runs/<name>/<stamp>]")] = None,
    format: Annotated[
        str | None,
        typer.Option("--format", help="csv, parquet, pab, merl, astm, json, zemax, lighttools, speos or cornell"),
    ] = None,
    column: Annotated[
        list[str],
        typer.Option("--column", "--columns", metavar="NAME=ROLE", help="what a column is, e.g. Ang1=theta_i, V=f:R"),
    ] = [],  # noqa: B006
    yes: Annotated[bool, typer.Option("--yes", help="take the columns as they were guessed")] = False,
    value: Annotated[str | None, typer.Option(help="what the values are: f, f_cos, factor or counts")] = None,
    scale: Annotated[float | None, typer.Option(help="the values are multiplied by it")] = None,
    angles: Annotated[str | None, typer.Option(help="degrees or radians [default: as the file shows]")] = None,
    specular: Annotated[
        int | None, typer.Option(help="azimuth of the mirror direction against the light's, 0 or 180 degrees")
    ] = None,
    symmetry: Annotated[str | None, typer.Option(help="isotropic or anisotropic [default: as is seen]")] = None,
    entries: Annotated[int, typer.Option(min=20, max=1_000_000, help="of a MERL table: how many bins")] = 20_000,
    name: Annotated[str | None, typer.Option(help="of the material [default: the file's]")] = None,
    force: Annotated[bool, typer.Option("--force", help="import what contradicts physics")] = False,
) -> None:
    """Make a run folder of readings measured elsewhere; reconstruct, report, export, evaluate and status work on it."""
    from gonio.importing import QUANTITIES, CannotImport
    from gonio.importing.delimited import Choices
    from gonio.importing.formats import FORMATS, TABLES, mapping_of, read, sniff
    from gonio.importing.run import take, write_run
    from gonio.run.prepare import new_name
    from gonio.run.record.folder import refuse_folder

    _one_of("--format", format, FORMATS)
    _one_of("--value", value, QUANTITIES)
    _one_of("--angles", angles, ("degrees", "radians"))
    _one_of("--specular", specular, (0, 180))
    _one_of("--symmetry", symmetry, ("isotropic", "anisotropic"))
    if scale is not None and not 0 < scale < float("inf"):
        raise CannotImport(f"--scale {scale}: a number above 0 expected")
    if out is not None:
        refuse_folder(out)
    kind = format or sniff(files[0])
    mapping = mapping_of(files[0], column) if kind in TABLES else None
    if mapping is not None:
        for line in mapping.lines():
            typer.echo(line)
        if mapping.guessed and not yes:
            raise CannotImport(
                f"{files[0]}: the columns are guessed and nothing was made; --yes takes them so, --column says better"
            )
    elif column:
        raise CannotImport(f"--column {column[0]}: a {kind} file has no columns to name")
    readings = read(files, kind, mapping, Choices(angles, specular), entries)
    taken = take(readings, quantity=value, scale=scale, symmetry=symmetry)
    for line in taken.said:
        typer.echo(f"note   {line}")
    for line in taken.doubts.lines:
        typer.echo(f"doubt  {line}")
    if taken.doubts.lines and not force:
        raise CannotImport(f"{files[0]}: {taken.doubts.lines[0]} Nothing was made; --force imports it")
    folder = out or Path("runs") / (name or files[0].stem) / new_name()
    write_run(folder, taken, readings, files, name)
    typer.echo(
        f"run    {folder}  ({len(taken.f)} readings of {len(taken.channels)} channels, {QUANTITIES[taken.quantity]})"
    )
    typer.echo(f"`gonio reconstruct {folder}` makes a BRDF of it, `gonio report {folder}` a page")


def _one_of(option: str, given, known) -> None:
    from gonio.importing import CannotImport

    if given is not None and given not in known:
        raise CannotImport(f"{option} {given}: not one of {', '.join(map(str, known))}")
