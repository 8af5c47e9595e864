"""scan: directions given by hand, measured through the same rig, planner and store."""

from pathlib import Path
from typing import Annotated

import typer

from gonio.commands.acquisition import Config, DaemonOption, RigOption, SetOption, configs, drive, products_of


def register(app: typer.Typer) -> None:
    app.command()(scan)


def scan(
    config: Config,
    table: Annotated[
        Path | None,
        typer.Argument(help="a CSV with theta_i_deg, theta_o_deg [phi_i_deg, phi_o_deg]: a row for each pair"),
    ] = None,
    theta_i: Annotated[
        list[float] | None, typer.Option(help="a scan in the plane of incidence, in place of a CSV; once each")
    ] = None,
    first: Annotated[float, typer.Option("--from", help="theta_o, negative on the light's side")] = -80.0,
    last: Annotated[float, typer.Option("--to", help="theta_o, positive on the mirror side")] = 80.0,
    step: Annotated[float, typer.Option(help="degrees")] = 5.0,
    phi: Annotated[float, typer.Option(help="azimuth of the mirror side on the sample")] = 0.0,
    repeats: Annotated[int, typer.Option(help="how often: the whole list, then all of it again")] = 1,
    rig: RigOption = "sim",
    out: Annotated[Path | None, typer.Option(help="the run folder to make [default: runs/<material>/<stamp>]")] = None,
    seed: Annotated[int | None, typer.Option(help="of simulated noise")] = None,
    set_: SetOption = [],  # noqa: B006 - typer reads the default, nothing changes it
    daemon: DaemonOption = None,
) -> None:
    """Measure a list of directions, or a plane of incidence, in place of the chain's; a run folder with table and plot.

    Pairs out of reach are left out. `resume` goes on with one that was interrupted; `reconstruct`, `report` and
    `export` take it as any other run.
    """
    from gonio.commands import through
    from gonio.config import ConfigError
    from gonio.config.scan import in_plane, read_scan
    from gonio.daemon.sockets import hold_hardware
    from gonio.run.start import start

    if (table is None) == (not theta_i):
        raise ConfigError("scan: name a CSV, or a plane of incidence by --theta-i; one of them")
    wanted = read_scan(table, repeats) if table else in_plane(theta_i or (), first, last, step, phi, repeats)
    material, rig_config = configs(config, rig, set_, seed)
    if (client := through.daemon_of(rig_config.name, daemon)) is not None:
        through.refuse_rig_keys(set_)
        products_of(through.acquire(client, material, out, wanted), True)
        return
    with hold_hardware(rig_config):
        run = start(material, rig_config, out, scan=wanted)
        n, most = run.config.material.budget.measurements or 0, len(wanted.pairs_deg) * repeats
        left_out = (most - n) // repeats
        typer.echo(f"run   {run.store.folder}")
        typer.echo(f"scan  {n // repeats} pairs, {repeats} x" + (f"; {left_out} out of reach" if left_out else ""))
        drive(run, True)
