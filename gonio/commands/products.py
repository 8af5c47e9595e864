"""reconstruct, evaluate, export, report: what is made of a run."""

from pathlib import Path
from typing import Annotated

import typer

from gonio.commands import as_json

RunFolder = Annotated[Path, typer.Argument(help="a run folder")]


def register(app: typer.Typer) -> None:
    for command in (reconstruct, evaluate, export, report, render):
        app.command()(command)


def reconstruct(
    run: RunFolder,
    model: Annotated[str | None, typer.Option(help="auto, thesis, ggx, lobes, abc [default: the config's]")] = None,
    out: Annotated[Path | None, typer.Option(help="where to save it [default: brdf.npz in the run]")] = None,
) -> None:
    """Make a BRDF of a run's samples."""
    from gonio.run.products import make_brdf

    typer.echo(make_brdf(run, model, out))


def evaluate(
    run: Annotated[str, typer.Argument(help="a run folder or a BRDF file")],
    truth: Annotated[str | None, typer.Option(help="the BRDF to compare with [default: the run's own truth]")] = None,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """Compare with a known BRDF: energy, brightness, log error, grazing; of a run its albedos too, with errors."""
    from gonio.run.products import albedo_of_run, evaluate_run

    figures = evaluate_run(run, truth)
    albedo = albedo_of_run(run)
    if json:
        as_json.say(figures | albedo.to_json())
        return
    typer.echo("  ".join(f"{k} {v:.4f}" for k, v in figures.items()))
    for name, values in albedo.rows().items():
        typer.echo(f"{name}  {values}")


def export(
    run: RunFolder,
    format: Annotated[
        str,
        typer.Option(
            "--format",
            help="bsdf, merl, grid, mountain, zemax, astm, xml or klems (Radiance), gltf, materialx; of the samples "
            "csv, parquet, netcdf, events, json (BRDF-JSON), nexus",
        ),
    ] = "bsdf",
    out: Annotated[Path | None, typer.Option(help="the file (or folder) to write [default: in the run]")] = None,
    spectral: Annotated[
        bool, typer.Option("--spectral", help="a .bsdf of wavelengths: spectral renderers refuse one of rgb")
    ] = False,
) -> None:
    """Write the BRDF, the samples or a fit in a format that other programs read; what it cannot hold is said."""
    import warnings

    from gonio.export import ExportWarning
    from gonio.run.exports import export_run

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", ExportWarning)
        typer.echo(export_run(run, format, out, spectral))
    for w in caught:
        if issubclass(w.category, ExportWarning):
            typer.echo(f"note   {w.message}", err=True)
    if format == "bsdf" and not spectral:
        typer.echo(
            f"note   spectral renderers refuse rgb: `gonio export {run} --spectral` writes wavelengths", err=True
        )


def report(
    run: RunFolder,
    figures: Annotated[
        str | None, typer.Option(help="`thesis`: the figures of the 2024 thesis on this run, or one by its number, 6.3")
    ] = None,
    truth: Annotated[
        str | None, typer.Option(help="with --figures: the BRDF to compare with [default: the run's own truth]")
    ] = None,
) -> None:
    """Write report.html: samples, slices beside the truth, acceptance, a shaded sphere; or figures of the thesis."""
    from gonio.run.products import make_figures, make_report

    if figures is None:
        typer.echo(make_report(run))
        return
    for line in make_figures(run, figures, truth):
        typer.echo(line)


def render(
    run: RunFolder,
    truth: Annotated[str | None, typer.Option(help="the BRDF to show beside it [default: the run's own truth]")] = None,
    size: Annotated[int, typer.Option(help="pixels a side")] = 256,
    spp: Annotated[int, typer.Option(help="samples per pixel")] = 256,
    band: Annotated[bool, typer.Option("--band", help="the interval of 95 %: its lower and upper end instead")] = False,
) -> None:
    """Render in Mitsuba 3: sphere and preview object, two skies; truth, ours, difference, with image metrics."""
    from gonio.run.products import render_band, render_run

    for line in render_band(run, size, spp) if band else render_run(run, truth, size, spp):
        typer.echo(line)
