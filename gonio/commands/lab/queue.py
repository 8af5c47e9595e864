"""queue: samples that wait for a rig; its daemon works them off."""

from pathlib import Path
from typing import Annotated, Any

import typer

from gonio.commands import as_json
from gonio.commands.acquisition import Config, SetOption, configs
from gonio.commands.owner import Which

app = typer.Typer(help="Samples that wait for a rig; its daemon works them off.", no_args_is_help=True)
Number = Annotated[int, typer.Argument(min=1, help="of the entry, as `list` shows it")]


@app.command()
def add(
    config: Config,
    scan: Annotated[Path | None, typer.Option(help="a CSV of directions, as `gonio scan` takes it")] = None,
    repeats: Annotated[int, typer.Option(help="of a scan")] = 1,
    seed: Annotated[int | None, typer.Option(help="seed of the chains (and of simulated noise)")] = None,
    set_: SetOption = [],  # noqa: B006 - typer reads the default, nothing changes it
    rig: Which = None,
) -> None:
    """One more sample, at the end."""
    from gonio.commands import through
    from gonio.config.scan import read_scan
    from gonio.daemon.client import the_one

    client = the_one(rig)
    through.refuse_rig_keys(set_)
    material, _ = configs(config, "ideal", set_, seed)
    body: dict[str, Any] = {"material": through.material_body(material)}
    if scan is not None:
        body["scan"] = read_scan(scan, repeats).model_dump(mode="json")
    typer.echo(f"entry {client.post('/queue', body)['id']}  {material.name}")


@app.command("list")
def list_(rig: Which = None, json: Annotated[bool, typer.Option("--json", help="print JSON")] = False) -> None:
    """What waits, runs, is done."""
    from gonio.daemon.client import the_one

    found = the_one(rig).get("/queue")
    as_json.say(found) if json else _show(found)


@app.command()
def move(number: Number, place: Annotated[int, typer.Argument(min=1, help="1 = next")] = 1, rig: Which = None) -> None:
    """Another place for one that waits."""
    from gonio.daemon.client import the_one

    _show(the_one(rig).post(f"/queue/{number}/move", {"place": place}))


@app.command()
def remove(number: Number, rig: Which = None) -> None:
    """Take one out; its run folder stays."""
    from gonio.daemon.client import the_one

    _show(the_one(rig).post(f"/queue/{number}/remove"))


@app.command()
def run(
    yes: Annotated[bool, typer.Option("--yes", help="ask for no sample: a changer puts them in")] = False,
    off: Annotated[bool, typer.Option("--off", help="no further than the run under way")] = False,
    rig: Which = None,
) -> None:
    """Have the daemon work it off; before each sample it pauses, says its name, and waits for `ready`."""
    from gonio.daemon.client import the_one

    _show(the_one(rig).post("/queue/work", {"active": not off, "ask": not yes}))


@app.command()
def ready(rig: Which = None) -> None:
    """The sample that was asked for is in its place."""
    from gonio.config import ConfigError
    from gonio.daemon.client import the_one

    client = the_one(rig)
    asks = client.get("/queue")["asks"]
    if not asks or not client.post("/continue")["done"]:
        raise ConfigError("queue: no sample is asked for; `gonio queue list` shows what it does")
    typer.echo(f"measures {asks}")


def _show(found: dict[str, Any]) -> None:
    for e in found["entries"]:
        words = "  ".join(w for w in ("scan" if e["scan"] else "", e["run"], e["message"]) if w)
        typer.echo(f"{e['id']:4}  {e['state']:8} {e['name']:24} {words}".rstrip())
    if found["asks"]:
        typer.echo(f"put in {found['asks']}, then `gonio queue ready`")
    elif not found["active"]:
        left = any(e["state"] in ("waiting", "running") for e in found["entries"])
        typer.echo("not worked off; `gonio queue run` begins" if left else "nothing waits")
