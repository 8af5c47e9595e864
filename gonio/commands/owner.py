"""daemon, status, watch, pause, stop: a rig owned by a process of its own, and what is asked of it."""

import time
from pathlib import Path
from typing import Annotated

import typer

from gonio.commands import as_json
from gonio.commands.rig import RigOption, rig_config

Which = Annotated[str | None, typer.Option("--rig", help="the rig's name [default: the only one that is driven]")]


def register(app: typer.Typer) -> None:
    for command in (daemon, status, watch, pause, stop):
        app.command()(command)


def daemon(
    rig: RigOption = "sim",
    runs: Annotated[Path, typer.Option(help="folder that run folders are made in")] = Path("runs"),
    tcp: Annotated[
        int | None, typer.Option(min=0, max=65535, help="also serve 127.0.0.1, with a token (0: any port)")
    ] = None,
) -> None:
    """Own a rig and serve it on a Unix socket; with --tcp, the live page too."""
    from gonio.daemon.launch import serve

    serve(rig_config(rig), runs, tcp, lambda line: typer.echo(line))


def status(
    run: Annotated[Path | None, typer.Argument(help="a run folder: what it holds, daemon or none")] = None,
    rig: Which = None,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """What the daemon's rig does now, and how its devices are; or what a run folder holds."""
    if run is not None:
        from gonio.run.holds import holds

        found = holds(run)
        if json:
            import json as js

            typer.echo(js.dumps(found))
        else:
            for key, what in found.items():
                typer.echo(f"{key:12} {', '.join(what) if isinstance(what, list) else what}")
        return
    from gonio.commands.watching import text_of
    from gonio.daemon.client import the_one

    state = the_one(rig).state()
    if json:
        as_json.say(state)
    else:
        typer.echo(text_of(state))


def watch(
    rig: Which = None,
    every: Annotated[float, typer.Option(min=0.1, help="seconds between two looks")] = 0.5,
    once: Annotated[bool, typer.Option(help="leave when the job under way has ended")] = False,
) -> None:
    """The live page, in the terminal. Ctrl-C leaves it; the run goes on."""
    import sys

    from gonio.commands.watching import text_of
    from gonio.daemon.client import the_one

    client, before = the_one(rig), ""
    live = sys.stdout.isatty()
    try:
        while True:
            state = client.state()
            text = text_of(state)
            if live:
                typer.echo("\x1b[H\x1b[J" + text)
            elif text != before:
                typer.echo(text + "\n")
            before = text
            if once and (state["job"] is None or state["job"]["ended"] is not None):
                return
            time.sleep(every)
    except KeyboardInterrupt:
        raise typer.Exit(0) from None


def pause(
    rig: Which = None, off: Annotated[bool, typer.Option("--off", help="go on with the run that is paused")] = False
) -> None:
    """Hold the run after the measurement under way; --off goes on."""
    from gonio.daemon.client import the_one

    done = the_one(rig).post("/continue" if off else "/pause")["done"]
    typer.echo(("goes on" if off else "pauses") if done else "nothing to go on with" if off else "no run to pause")


def stop(rig: Which = None) -> None:
    """Halt the motors now and end the job; what was measured is stored."""
    from gonio.daemon.client import the_one

    client = the_one(rig)
    if not client.post("/stop")["done"]:
        typer.echo("nothing was moving")
        return
    deadline = time.monotonic() + 30
    while (state := client.state())["job"]["ended"] is None and time.monotonic() < deadline:
        time.sleep(0.05)
    job = state["job"]
    typer.echo("stopped" + (f"; `gonio resume {job['run']}` goes on" if "run" in job else ""))
