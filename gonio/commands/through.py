"""acquire and resume through the rig's daemon: the same lines on the terminal, the rig in another process."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import typer

from gonio.config import ConfigError, Material
from gonio.config.scan import Scan


def daemon_of(rig: str, wanted: bool | None):
    """The daemon's client, None to do without. Raises ConfigError where one was asked for and none runs."""
    from gonio.daemon.client import find

    client = None if wanted is False else find(rig)
    if wanted and client is None:
        raise ConfigError(f"no daemon runs for rig {rig}; start one with `gonio daemon --rig {rig}`")
    return client


def refuse_rig_keys(overrides: list[str]) -> None:
    if theirs := [o for o in overrides if o.startswith("rig.")]:
        raise ConfigError(f"--set {theirs[0]}: the daemon has its own rig config; end it first, or use --no-daemon")


def check(client, material: Material, out: Path | None) -> dict[str, Any]:
    """`plan`, what the daemon would do with the material, its `figures`; `busy`, what it does now, "" for nothing."""
    return client.post("/check", _body(client, material, out))


def acquire(client, material: Material, out: Path | None, scan: Scan | None = None) -> Path:
    """The finished run's folder."""
    body = _body(client, material, out)
    if scan is not None:
        body["scan"] = scan.model_dump(mode="json")
    return _watch(client, client.post("/jobs/acquire", body)["job"])


def _body(client, material: Material, out: Path | None) -> dict[str, Any]:
    runs = Path(client.state()["runs"])
    body: dict[str, Any] = {"material": material_body(material)}
    if out is not None:
        from gonio.daemon.request_paths import relative

        body["run"] = relative(runs, out)
    return body


def material_body(material: Material) -> dict[str, Any]:
    """As a request holds it."""
    body = material.model_dump(mode="json")
    if (flow := body["sampler"]["flow"])["weights"] is not None:
        flow["weights"] = str(Path(flow["weights"]).resolve())  # the daemon stands in another folder
    if (target := body["sampler"]["target"])["scene"] is not None:
        target["scene"] = str(Path(target["scene"]).resolve())
    return body


def resume(client, run: Path, overrides: list[str]) -> Path:
    """As `acquire`; a run of this daemon's that is paused goes on."""
    from gonio.daemon.request_paths import relative

    state = client.state()
    job = state["job"] or {}
    if job.get("run") == str(run.resolve()) and job["ended"] is None and state["state"] == "paused":
        client.post("/continue")
        return _watch(client, job["id"])
    name = relative(Path(state["runs"]), run)
    return _watch(client, client.post("/jobs/resume", {"run": name, "set": overrides})["job"])


def _watch(client, job: int) -> Path:
    from gonio.commands.interrupt import Interrupt
    from gonio.commands.progress import ProgressLine

    entry = client.state()["job"]
    folder = Path(entry["run"])
    typer.echo(f"run   {folder}  (by the daemon of rig {client.rig})")
    if entry.get("truth"):
        typer.echo(f"truth {entry['truth']}")
    try:
        with Interrupt() as interrupt, ProgressLine() as line:
            done = client.wait(job, lambda state: _show(line, state), interrupt)
    except Exception as e:
        if getattr(e, "exit_code", None) in (3, 4, 130) and folder.exists():
            typer.echo(f"all that was measured is stored; `gonio resume {folder}` goes on", err=True)
        raise
    typer.echo(f"ended {done['result']['reason']}")
    return folder


def _show(line, state: dict[str, Any]) -> None:
    if (p := state["job"].get("progress")) is not None:
        line.update(SimpleNamespace(**p, eta_s=lambda: p["wall_left_s"]))
