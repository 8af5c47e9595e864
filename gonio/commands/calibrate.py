"""calibrate camera, geometry, radiometry: each writes a dated file that the rig's YAML then names."""

from pathlib import Path
from typing import Annotated

import typer

from gonio.commands.rig import RigOption, rig_config

app = typer.Typer(help="Calibrate camera, geometry or radiometry of a rig.", no_args_is_help=True)
Out = Annotated[Path, typer.Option(help="folder of calibrations")]
FOLDER = Path("calibrations")


@app.command()
def camera(
    views: Annotated[list[Path] | None, typer.Argument(help="pictures of the board, 15 or more")] = None,
    rig: RigOption = "sim",
    out: Out = FOLDER,
    across: Annotated[int, typer.Option(help="squares of the board across, odd")] = 7,
    down: Annotated[int, typer.Option(help="squares down, odd")] = 5,
    square_mm: Annotated[float, typer.Option(min=1, help="side of a square, as printed")] = 30.0,
    marker_mm: Annotated[float, typer.Option(min=1, help="side of a marker, as printed")] = 22.0,
    board: Annotated[Path | None, typer.Option(help="write the board to print as this PNG, and end")] = None,
) -> None:
    """The camera's pinhole and distortion from pictures of a ChArUco board."""
    from calibration.camera import Board, board_image, calibrate_camera, read_views
    from gonio.config import ConfigError

    try:
        made = Board(across, down, square_mm / 1000, marker_mm / 1000)
    except ValueError as e:
        raise ConfigError(str(e)) from None
    if board is not None:
        import cv2

        if not cv2.imwrite(str(board), board_image(made)):
            raise ConfigError(f"{board}: cannot be written; name a .png in a folder that exists")
        typer.echo(f"board  {board}: print it so that a square measures {square_mm:g} mm")
        return
    if not views:
        raise ConfigError("name pictures of the board; --board FILE.png makes one to print")
    config = rig_config(rig)
    found = calibrate_camera(read_views(views), made, config.name, config.depth != "real")
    _save(found, out, f"{found.views} views, reprojection {found.rms_px:.2f} pixels")


@app.command()
def geometry(
    observations: Annotated[Path, typer.Argument(help="CSV: kind, <axis>_deg of every axis, x, y, z")],
    rig: RigOption = "sim",
    out: Out = FOLDER,
) -> None:
    """Offsets and tilts of the axes from mirrors and directions seen."""
    from calibration.geometry import calibrate_geometry
    from calibration.observations import read_observations

    config = rig_config(rig)
    found = calibrate_geometry(read_observations(observations, config), config, simulated=config.depth != "real")
    _save(found, out, f"observations agree to {found.residual_deg:.3f} degrees")


@app.command()
def radiometry(
    f: Annotated[list[float], typer.Option(help="the reference's BRDF, 1/sr, from its certificate; once per channel")],
    theta_i: Annotated[float, typer.Option(min=0, max=84, help="degrees, of the certificate")] = 45.0,
    theta_o: Annotated[float, typer.Option(min=0, max=84, help="degrees, opposite the light")] = 0.0,
    rig: RigOption = "sim",
    out: Out = FOLDER,
) -> None:
    """Gain, dark and linearity of the detector from a white reference in the sample's place."""
    import numpy as np

    from calibration.radiometry import measure_reference
    from gonio.brdf.lambert import Lambert
    from gonio.config import ConfigError
    from gonio.daemon.client import find
    from gonio.daemon.held import Held
    from gonio.daemon.place import hold_hardware

    config = rig_config(rig)
    if config.depth == "ideal":
        raise ConfigError(f"rig {config.name} is ideal and has no detector to calibrate")
    if find(config.name) is not None:
        raise ConfigError(f"rig {config.name}: a daemon drives it; end the daemon, calibrate, start it again")
    # what lies on a simulated rig is the reference itself
    reference = None if config.depth == "real" else Lambert(np.pi * np.array(f))
    with hold_hardware(config), Held(config) as held:
        found = measure_reference(held.as_is(reference, calibrated=False), theta_i, theta_o, np.array(f))
    gains = ", ".join(f"{g:.4g} ± {s:.1g}" for g, s in zip(found.gain, found.gain_sigma))
    _save(found, out, f"gain {gains}, linearity {found.linearity:+.2%}")


def _save(found, folder: Path, text: str) -> None:
    from gonio.rig.calibration import save_calibration

    path = save_calibration(found, folder)
    typer.echo(f"{found.kind}  {text}\nfile  {path}: name it in the rig's YAML as calibration.{found.kind}")
