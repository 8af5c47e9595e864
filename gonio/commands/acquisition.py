"""acquire, resume, check: a run from its config to its folder."""

from pathlib import Path
from typing import Annotated

import typer

from gonio.commands import as_json

Config = Annotated[str, typer.Argument(help="a material's YAML, or the name of one that ships")]
RigOption = Annotated[str, typer.Option("--rig", help="a rig's YAML, or the name of one that ships")]
SetOption = Annotated[
    list[str], typer.Option("--set", metavar="KEY=VALUE", help="override any key, e.g. budget.measurements=500")
]
DaemonOption = Annotated[
    bool | None, typer.Option("--daemon/--no-daemon", help="through the rig's daemon [default: where one runs]")
]
AllowStale = Annotated[
    bool, typer.Option("--allow-stale", help="measure with calibrations too old or of another rig; the run says so")
]
RunFolder = Annotated[Path, typer.Argument(help="a run folder")]


def register(app: typer.Typer) -> None:
    app.command()(acquire)
    app.command()(resume)
    app.command()(check)


def acquire(
    config: Config,
    rig: RigOption = "sim",
    out: Annotated[Path | None, typer.Option(help="the run folder to make [default: runs/<material>/<stamp>]")] = None,
    seed: Annotated[int | None, typer.Option(help="seed of the chains (and of simulated noise)")] = None,
    set_: SetOption = [],  # noqa: B006 - typer reads the default, nothing changes it
    post: Annotated[bool, typer.Option(help="make the BRDF, its .bsdf and the report when done")] = True,
    allow_stale: AllowStale = False,
    daemon: DaemonOption = None,
) -> None:
    """Measure a material: drive the rig by the chain, store every reading, make the BRDF and the report."""
    from gonio.commands import through
    from gonio.daemon.sockets import hold_hardware
    from gonio.run.start import start

    set_ = [*set_, *["rig.calibration.allow_stale=true"] * allow_stale]
    material, rig_config = configs(config, rig, set_, seed)
    if (client := through.daemon_of(rig_config.name, daemon)) is not None:
        through.refuse_rig_keys(set_)
        products_of(through.acquire(client, material, out), post)
        return
    with hold_hardware(rig_config):
        run = start(material, rig_config, out)
        typer.echo(f"run   {run.store.folder}")
        drive(run, post)


def resume(
    run: RunFolder,
    set_: SetOption = [],  # noqa: B006
    post: Annotated[bool, typer.Option(help="make the BRDF, its .bsdf and the report when done")] = True,
    allow_stale: AllowStale = False,
    daemon: DaemonOption = None,
) -> None:
    """Go on with an interrupted run: the very chain an uninterrupted one would have been."""
    from gonio.commands import through
    from gonio.daemon.sockets import hold_hardware
    from gonio.run.record.config import read_config
    from gonio.run.start import resume as reopen

    rig_config = read_config(run).rig
    if (client := through.daemon_of(rig_config.name, daemon)) is not None:
        products_of(through.resume(client, run, set_), post)
        return
    with hold_hardware(rig_config):
        drive(reopen(run, tuple(set_), allow_stale=allow_stale), post)


def check(
    config: Config,
    rig: RigOption = "sim",
    seed: Annotated[int | None, typer.Option()] = None,
    set_: SetOption = [],  # noqa: B006
    out: Annotated[Path | None, typer.Option(help="the run folder that is to be made")] = None,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
    daemon: DaemonOption = None,
) -> None:
    """Read a config and all it names, and print what it would do: reachable share, estimated rig time. No hardware.

    Whatever `acquire` would refuse before it moves is refused; a rig that is busy, after the plan.
    """
    from gonio.commands import through
    from gonio.daemon.client import Refused
    from gonio.daemon.sockets import hold_hardware
    from gonio.run.check import plan_of

    material, rig_config = configs(config, rig, set_, seed)
    if (client := through.daemon_of(rig_config.name, daemon)) is not None:
        through.refuse_rig_keys(set_)
        found = through.check(client, material, out)
        as_json.say(found["figures"]) if json else typer.echo(found["plan"])
        if found["busy"]:
            raise Refused(found["busy"], 2)
        return
    plan = plan_of(material, rig_config, out)
    as_json.say(plan.figures) if json else typer.echo(plan.text)
    with hold_hardware(rig_config):
        pass


def configs(config: str, rig: str, overrides: list[str], seed: int | None):
    from gonio.config import Material, load_config
    from gonio.config.find import find_config
    from gonio.config.rig import RigConfig

    ours = [o for o in overrides if not o.startswith("rig.")]
    theirs = [o.removeprefix("rig.") for o in overrides if o.startswith("rig.")]
    if seed is not None:
        ours.append(f"seed={seed}")
    material = load_config(find_config(config, "materials"), Material, ours)
    return material, load_config(find_config(rig, "rigs"), RigConfig, theirs)


def drive(run, post: bool) -> None:
    from gonio.commands.interrupt import Interrupt
    from gonio.commands.progress import ProgressLine

    origin = run.store.get("provenance", {}).get("truth")
    if origin:
        typer.echo(f"truth {origin}")
    try:
        with Interrupt() as interrupt, ProgressLine() as line:
            reason = run(watch=line.update, interrupted=interrupt)
    except BaseException as e:
        interrupted = getattr(e, "exit_code", None) in (3, 4, 130) or isinstance(e, KeyboardInterrupt)
        if not run.store.folder.exists():
            typer.echo("nothing was measured, and no run folder is left", err=True)
        elif interrupted:
            typer.echo(f"all that was measured is stored; `gonio resume {run.store.folder}` goes on", err=True)
        raise
    finally:
        run.close()
    typer.echo(f"ended {reason}")
    products_of(run.store.folder, post)


def products_of(folder: Path, post: bool) -> None:
    if post:
        from gonio.run.products import make_products

        for made in make_products(folder):
            typer.echo(made)
