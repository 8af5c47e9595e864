"""scene: what a picture asks of a material, so that only that is measured."""

from pathlib import Path
from typing import Annotated

import typer


def register(app: typer.Typer) -> None:
    app.command()(scene)


def scene(
    scene: Annotated[str, typer.Argument(help="a Mitsuba scene, or the name of one that ships: sky, panel, interior")],
    bsdf: Annotated[str, typer.Option(help="id of the BSDF that is to be measured")] = "measured",
    out: Annotated[Path | None, typer.Option(help="file to write [default: the scene's name with .npz, here]")] = None,
    preview: Annotated[Path | None, typer.Option(help="picture of what is used, .png")] = None,
    material: Annotated[
        str, typer.Option(help="with --preview: a material like the one to be measured, for the rig time")
    ] = "analytic_gloss",
    size: Annotated[int, typer.Option(min=8, max=1024, help="pixels across")] = 128,
    spp: Annotated[int, typer.Option(min=1, max=4096, help="paths per pixel")] = 64,
    seed: Annotated[int, typer.Option(min=0, max=2**31 - 1)] = 0,
) -> None:
    """Trace a scene once and write with which directions the material enters the picture."""
    from gonio.render.scene.files import find_scene
    from gonio.render.scene.record import record
    from gonio.render.scene.used import used

    path = find_scene(scene)
    found = record(path, bsdf, size=size, spp=spp, seed=seed)
    out = out or Path(f"{path.stem}.npz")
    found.picture.save(out)
    typer.echo(f"scene    {path.name}, {bsdf}: {found.hits} hits, {found.picture.share:.0%} of the picture's light")
    known = used(found.picture, material)
    for line in known.lines:
        typer.echo(line)
    if preview is not None:
        from gonio.render.scene.preview import draw

        draw(found, known, preview)
        typer.echo(f"preview  {preview}")
    typer.echo(f"file     {out}: name it in the material's YAML as sampler.target.scene")
