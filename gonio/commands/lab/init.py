"""init rig, init material: the first YAML, with comments; nothing is asked."""

from pathlib import Path
from typing import Annotated, Any

import typer

app = typer.Typer(help="Write a commented YAML to begin with: of a rig, of a material.", no_args_is_help=True)
Name = Annotated[str, typer.Argument(help="its name; the file is NAME.yaml")]
Out = Annotated[Path | None, typer.Option(help="the file to write [default: NAME.yaml]")]
Force = Annotated[bool, typer.Option("--force", help="write over a file that is there")]


@app.command()
def rig(
    name: Name = "lab",
    ports: Annotated[
        list[str] | None,
        typer.Option(help="a serial port to look at; once each [default: all in /dev/serial/by-id]"),
    ] = None,
    look: Annotated[bool, typer.Option(help="ask the ports who is there; moves nothing")] = True,
    kinematics: Annotated[str, typer.Option(help="gantry or gimbal")] = "gantry",
    detector: Annotated[str, typer.Option(help="photodiode or camera")] = "photodiode",
    stage: Annotated[str | None, typer.Option(help="the servos' port, without looking")] = None,
    photodiode: Annotated[str | None, typer.Option(help="the photodiode's port, without looking")] = None,
    light: Annotated[str | None, typer.Option(help="the lamp's port, without looking")] = None,
    camera: Annotated[str | None, typer.Option(help="the camera, by its name in /dev/v4l/by-id")] = None,
    out: Out = None,
    force: Force = False,
) -> None:
    """A real rig's YAML, with what answers on the ports filled in."""
    from gonio.config import ConfigError
    from gonio.config.rig import RigConfig
    from gonio.config.templates import axes_of, rig_yaml

    _one_of("--kinematics", kinematics, ("gantry", "gimbal"))
    _one_of("--detector", detector, ("photodiode", "camera"))
    name = name.removesuffix(".yaml")
    path = _free(name, out, force)
    given: dict[str, Any] = {"stage": stage, "photodiode": photodiode, "light": light}
    found = _found([p for p in ports or () if p not in given.values()], ports is None, look, set(given.values()))
    names = axes_of(kinematics)
    if found is not None and stage is None and found.stage is not None:
        if len(found.servos) == len(names):
            given["ids"] = dict(zip(names, found.servos))
        given |= {"stage": found.stage, "baud": found.stage_baud, "model": found.model}
    for kind in ("photodiode", "light"):
        given[kind] = given[kind] or getattr(found, kind, None)
    lines = [] if found is None else found.lines
    text = rig_yaml(
        name, kinematics=kinematics, detector=detector, camera=camera or _camera(), found=lines, **given
    )  # fmt: skip
    _write(path, text, RigConfig, ConfigError)
    typer.echo(f"wrote {path}; `gonio doctor --rig {path}` says what is missing")


@app.command()
def material(
    name: Name,
    symmetry: Annotated[str, typer.Option(help="isotropic or anisotropic")] = "isotropic",
    channels: Annotated[str, typer.Option(help="their names, with commas")] = "R,G,B",
    truth: Annotated[str | None, typer.Option(help="what a simulated rig shows")] = None,
    measurements: Annotated[int | None, typer.Option(help="budget of measurements")] = 2000,
    rig_hours: Annotated[float | None, typer.Option(help="budget of rig time")] = None,
    energy_error: Annotated[float | None, typer.Option(help="estimated error that ends the run")] = None,
    sample_id: Annotated[str | None, typer.Option(help="what the sample's label says")] = None,
    operator: Annotated[str | None, typer.Option(help="who measures")] = None,
    notes: Annotated[str | None, typer.Option(help="anything worth knowing")] = None,
    out: Out = None,
    force: Force = False,
) -> None:
    """A material's YAML: one sample, and the run to make of it."""
    from gonio.config import ConfigError, Material
    from gonio.config.templates import material_yaml

    _one_of("--symmetry", symmetry, ("isotropic", "anisotropic"))
    name = name.removesuffix(".yaml")
    path = _free(name, out, force)
    text = material_yaml(
        name, symmetry=symmetry, channels=[c.strip() for c in channels.split(",") if c.strip()], truth=truth,
        measurements=measurements, rig_hours=rig_hours, energy_error=energy_error,
        sample_id=sample_id, operator=operator, notes=notes,
    )  # fmt: skip
    _write(path, text, Material, ConfigError)
    typer.echo(f"wrote {path}; `gonio check {path} --rig R` says what it would do")


def _found(ports: list[str], all_of_them: bool, look: bool, taken: set[str | None]):
    if not look:
        return None
    from drivers.ports.finding import find, ports_by_id

    ports = [p for p in ports_by_id() if p not in taken] if all_of_them else ports
    return find(ports, lambda line: typer.echo(f"port  {line}")) if ports else None


def _camera() -> str | None:
    return next((str(p) for p in sorted(Path("/dev/v4l/by-id").glob("*index0"))), None)


def _one_of(option: str, value: str, known: tuple[str, ...]) -> None:
    from gonio.config import ConfigError

    if value not in known:
        raise ConfigError(f"{option} {value}: not one of {', '.join(known)}")


def _free(name: str, out: Path | None, force: bool) -> Path:
    """The file to write. Raises ConfigError where there is one already, before any port is asked."""
    from gonio.config import ConfigError

    path = out or Path(f"{name}.yaml")
    if path.is_dir() or (path.exists() and not force):
        raise ConfigError(f"{path}: exists already; name another with --out, or write over it with --force")
    if not path.absolute().parent.is_dir():
        raise ConfigError(f"{path}: there is no folder {path.parent}; make it first")
    return path


def _write(path: Path, text: str, model, config_error) -> None:
    """Only what loads is written: what was given by options is said by its key where it cannot be."""
    from gonio.atomic import write_text
    from gonio.config.loader import parse_config

    parse_config(text, model, source="what the options give")
    try:
        write_text(path, text)
    except OSError as e:
        raise config_error(f"{path}: {e.strerror}; name another file with --out") from None
