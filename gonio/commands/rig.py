"""doctor, home, park, jog, measure: the rig by hand. Asked of the daemon where one drives the rig, else done here."""

from typing import Annotated, Any

import typer

from gonio.commands import as_json

RigOption = Annotated[str, typer.Option("--rig", help="a rig's YAML, or the name of one that ships")]
Theta = Annotated[float, typer.Argument(min=0, max=89.999, help="degrees from the normal")]
Phi = Annotated[float, typer.Option(min=-360, max=360, help="degrees of azimuth")]


def register(app: typer.Typer) -> None:
    for command in (doctor, home, park, jog, measure):
        app.command()(command)


def doctor(
    rig: RigOption = "sim",
    reboot: Annotated[
        str | None, typer.Option(metavar="AXIS", help="first restart this servo; its arm may sag: hold it")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """Find, name and test the rig's devices; say what is missing and what to do. Exits with 3 where something is."""
    from gonio.daemon.sockets import hold_hardware

    config = rig_config(rig)
    with hold_hardware(config):
        if reboot is not None:
            _reboot(config, reboot)
        lines = _doctor(config)
    if json:
        as_json.say(_findings(config, lines))
    else:
        typer.echo("\n".join(lines))
    if any(line.startswith("FAIL") for line in lines):
        raise typer.Exit(3)


def home(rig: RigOption = "sim") -> None:
    """Confirm the zero of every axis; nothing moves before."""
    _say_pose(_by_hand(rig, "home", {}))


def park(rig: RigOption = "sim") -> None:
    """Light off, arms to their pose of rest."""
    _say_pose(_by_hand(rig, "park", {}))


def jog(
    axis: Annotated[str, typer.Argument(help="its name in the rig's YAML")],
    degrees: Annotated[float, typer.Argument(min=-360, max=360, help="how far, e.g. 5; `-- -5` for a negative one")],
    rig: RigOption = "sim",
) -> None:
    """Turn one axis, inside its limits and clear of the stay-out cone."""
    _say_pose(_by_hand(rig, "jog", {"axis": axis, "degrees": degrees}))


def measure(
    theta_i: Theta,
    theta_o: Theta,
    phi_i: Phi = 0.0,
    phi_o: Phi = 180.0,
    rig: RigOption = "sim",
    truth: Annotated[
        str | None,
        typer.Option(help="what a simulated rig shows [default: what lay on it last; at first, a white diffuser]"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> None:
    """One reading at a pair of directions: the BRDF in 1/sr and its standard deviation."""
    angles = {"theta_i_deg": theta_i, "phi_i_deg": phi_i, "theta_o_deg": theta_o, "phi_o_deg": phi_o}
    found = _by_hand(rig, "measure", {**angles, "truth": truth})
    if json:
        as_json.say(found)
        return
    if "f" not in found:
        raise KeyboardInterrupt
    values = "  ".join("-" if f is None else f"{f:.6g} ± {s:.2g}" for f, s in zip(found["f"], found["sigma"]))
    at = "theta_i {theta_i_deg:g}  phi_i {phi_i_deg:g}  theta_o {theta_o_deg:g}  phi_o {phi_o_deg:g}".format(**found)
    typer.echo(f"f   {values}  1/sr{'  saturated' if found['saturated'] else ''}\nat  {at}  degrees")


def rig_config(rig: str):
    """The rig's config, by path or name."""
    from gonio.config import load_config
    from gonio.config.find import find_config
    from gonio.config.rig import RigConfig

    return load_config(find_config(rig, "rigs"), RigConfig)


def _by_hand(rig: str, kind: str, params: dict[str, Any]) -> dict[str, Any]:
    """The job's result, from the rig's daemon or from a rig opened for it alone. Ctrl-C stops the motors first."""
    from gonio.commands.interrupt import Interrupt
    from gonio.daemon import manual
    from gonio.daemon.client import find
    from gonio.daemon.rig_owner import RigOwner
    from gonio.daemon.sockets import hold_hardware

    config = rig_config(rig)
    if (client := find(config.name)) is not None:
        job = client.post(f"/jobs/{kind}", params or None)["job"]
        with Interrupt() as interrupt:
            return client.wait(job, interrupted=interrupt)["result"]
    with Interrupt.at_once(), hold_hardware(config), RigOwner(config) as owner:
        if kind == "jog":
            return manual.jog(owner, params["axis"], params["degrees"])
        if kind == "measure":
            angles = tuple(params[k] for k in ("theta_i_deg", "phi_i_deg", "theta_o_deg", "phi_o_deg"))
            return manual.measure(owner, angles, params["truth"])  # type: ignore[arg-type]
        return {"home": manual.home, "park": manual.park}[kind](owner)


def _say_pose(result: dict[str, Any]) -> None:
    typer.echo("at  " + "  ".join(f"{k} {v:g}" for k, v in (result.get("pose_deg") or {}).items()) + "  degrees")


def _reboot(config, axis: str) -> None:
    from gonio.config import ConfigError

    if config.depth != "real":
        raise ConfigError(f"--reboot {axis}: rig {config.name} is simulated and has no servo to restart")
    if axis not in config.axis_names:
        raise ConfigError(f"--reboot {axis}: no such axis; they are {', '.join(config.axis_names)}")
    from drivers.rig import reboot

    reboot(config, axis)


def _findings(config, lines: list[str]) -> dict[str, Any]:
    """Each line apart: level ok, warn, FAIL, or note for what is no check."""
    rows = []
    for line in lines:
        level, _, text = line.partition(" ")
        known = level in ("ok", "warn", "FAIL")
        rows.append({"level": level if known else "note", "text": " ".join((text if known else line).split())})
    well = not any(row["level"] == "FAIL" for row in rows)
    return {"rig": config.name, "depth": config.depth, "well": well, "findings": rows}


def _doctor(config) -> list[str]:
    if config.depth == "real":
        from drivers.doctor import doctor

        return list(doctor(config))
    from gonio.daemon.simulated_checkup import checkup

    return checkup(config)
