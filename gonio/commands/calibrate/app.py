"""calibrate camera, geometry, radiometry: each writes a dated file that the rig's YAML then names."""

from pathlib import Path
from typing import Annotated

import typer

from gonio.commands.calibrate.rig_alone import FOLDER, alone, ask, owned
from gonio.commands.rig import RigOption, rig_config

app = typer.Typer(help="Calibrate camera, geometry or radiometry of a rig.", no_args_is_help=True)
Out = Annotated[Path, typer.Option(help="folder of calibrations")]
F = Annotated[
    list[float] | None, typer.Option(help="the reference's BRDF, 1/sr, from its certificate; once per channel")
]
Table = Annotated[
    Path | None, typer.Option(help="its f by angles, as CSV: theta_i_deg, theta_o_deg, phi_deg, f or f1, f2, ...")
]
U = Annotated[float, typer.Option("--u", min=0, max=50, help="its standard uncertainty (k = 1), percent")]
ThetaI = Annotated[float, typer.Option(min=0, max=84, help="with --f: degrees, of the certificate")]
ThetaO = Annotated[float, typer.Option(min=0, max=84, help="with --f: degrees, opposite the light")]
Yes = Annotated[bool, typer.Option("--yes", help="everything is in place: ask nothing")]


@app.command()
def camera(
    views: Annotated[list[Path] | None, typer.Argument(help="pictures of the board, 15 or more")] = None,
    rig: RigOption = "sim",
    out: Out = FOLDER,
    across: Annotated[int, typer.Option(help="squares of the board across")] = 7,
    down: Annotated[int, typer.Option(help="squares down")] = 5,
    dictionary: Annotated[str, typer.Option(help="ArUco dictionary of the board, by OpenCV's name")] = "DICT_4X4_50",
    legacy: Annotated[
        bool | None,
        typer.Option("--legacy/--new", help="pattern of OpenCV before 4.6 [default: as pictures say]"),
    ] = None,
    square_mm: Annotated[float, typer.Option(min=1, help="side of a square, as printed")] = 30.0,
    marker_mm: Annotated[float, typer.Option(min=1, help="side of a marker, as printed")] = 22.0,
    board: Annotated[Path | None, typer.Option(help="write the board to print as this PNG, and end")] = None,
    poses: Annotated[
        Path | None, typer.Option(help="CSV: view, <axis>_deg of every axis; the board lies in the sample's place")
    ] = None,
    take: Annotated[
        Path | None, typer.Option(help="take this picture now, lamp on, and add its pose to --poses [poses.csv]")
    ] = None,
    drive: Annotated[
        int | None,
        typer.Option(min=8, max=200, help="the rig takes so many pictures itself, into --views; the board lies there"),
    ] = None,
    views_to: Annotated[Path, typer.Option("--views", help="folder of the pictures that --drive takes")] = Path(
        "views"
    ),
    yes: Yes = False,
    dark: Annotated[bool, typer.Option("--dark", help="measure dark frames and bad pixels; the lamp goes off")] = False,
    flat: Annotated[bool, typer.Option("--flat", help="measure the flat frame; a diffuser is before the lens")] = False,
) -> None:
    """The camera: optics by pictures of a ChArUco board, with --poses its mount; or --drive, --take, --dark, --flat."""
    from calibration.board import Board, board_image, contradiction, find_corners, recognised
    from calibration.camera import calibrate_camera, read_views
    from calibration.mount import calibrate_mount, read_poses
    from gonio.config import ConfigError
    from gonio.rig.errors import CalibrationMissing

    try:
        made = Board(across, down, square_mm / 1000, marker_mm / 1000, dictionary, bool(legacy))
    except ValueError as e:
        raise ConfigError(str(e)) from None
    if board is not None:
        import cv2

        from gonio.atomic import beside

        try:
            with beside(board) as part:
                if not cv2.imwrite(str(part), board_image(made)):
                    raise OSError
        except (OSError, cv2.error):
            raise ConfigError(f"{board}: cannot be written; name a .png in a folder that exists") from None
        typer.echo(f"board  {board}: print it so that a square measures {square_mm:g} mm")
        return
    if take is not None:
        _take(rig, take, poses or take.with_name("poses.csv"))
        return
    if dark or flat:
        _frames(rig, out, flat)
        return
    if drive is not None:
        from gonio.commands.calibrate.calibrating import views_by_driving

        with owned(rig) as owner:
            views, poses = views_by_driving(owner, made, drive, views_to, ask(owner, yes))
    if not views:
        raise ConfigError(
            "name pictures of the board (--board FILE.png makes one to print), or --drive, --take, --dark, --flat"
        )
    config = rig_config(rig)
    pictures = read_views(views)
    seen_board = recognised(pictures, made)
    if (seen_board.across, seen_board.down) != (across, down) or (legacy is not None and seen_board != made):
        how = f"--across {seen_board.across} --down {seen_board.down} {'--legacy' if seen_board.legacy else '--new'}"
        raise CalibrationMissing(f"camera: the pictures show a board of {seen_board}, not of {made}; call it {how}")
    if seen_board != made:
        typer.echo(f"board  {seen_board}, as the pictures show")
    corners = find_corners(pictures, seen_board)
    if against := contradiction(pictures, seen_board, corners):
        raise CalibrationMissing(f"camera: {against}")
    height, width = pictures[0].shape
    found = calibrate_camera(corners, (width, height), config.name, config.depth != "real")
    text = f"{found.views} views, reprojection {found.rms_px:.2f} pixels"
    if poses is not None:
        known = read_poses(poses, config)
        if lost := [v.name for v in views if v.name not in known]:
            raise CalibrationMissing(f"{poses}: no row for the view {lost[0]}; give every picture its pose")
        seen = [(c, known[v.name]) for c, v in zip(corners, views) if c is not None]
        found = calibrate_mount(found, [c for c, _ in seen], [p for _, p in seen], config)
        text += f", mount {found.mount_rms_px:.2f} pixels"
    _save(found, out, text)


@app.command()
def geometry(
    observations: Annotated[
        Path | None, typer.Argument(help="CSV of what was seen: kind, <axis>_deg of every axis, x, y, z")
    ] = None,
    rig: RigOption = "sim",
    out: Out = FOLDER,
    mirror: Annotated[bool, typer.Option("--mirror", help="the rig looks by itself at a mirror in its middle")] = False,
    wedge: Annotated[
        float, typer.Option(min=0, max=30, help="then at the mirror on a wedge of so many degrees; 0: not")
    ] = 15.0,
    yes: Yes = False,
    force: Annotated[bool, typer.Option("--force", help="save a fit that does not explain what was seen")] = False,
) -> None:
    """Zeros, tilts, eccentricity, backlash and centres of the axes: by a mirror, or from a table of what was seen."""
    import numpy as np

    from calibration.geometry import calibrate_geometry, read_observations
    from gonio.commands.calibrate.calibrating import WEAK, geometry_by_mirror
    from gonio.config import ConfigError

    if mirror == (observations is not None):
        raise ConfigError("calibrate geometry: give a CSV of what was seen, or --mirror, and not both")
    if mirror:
        with owned(rig, "geometry", out) as owner:
            typer.echo(geometry_by_mirror(owner, out, wedge, ask(owner, yes), force=force).text)
        return
    assert observations is not None
    config = rig_config(rig)
    found = calibrate_geometry(read_observations(observations, config), config, simulated=config.depth != "real")
    sure = found.directions_sigma_deg or 0.0
    _save(found, out, f"observations agree to {found.residual_deg:.3f} degrees; a direction is known to {sure:.3f}")
    if np.radians(sure) > WEAK:
        typer.echo("warning  that is little: these observations do not tell the geometry; add others", err=True)


@app.command()
def radiometry(
    f: F = None,
    table: Table = None,
    u: U = 0.5,
    theta_i: ThetaI = 45.0,
    theta_o: ThetaO = 0.0,
    rig: RigOption = "sim",
    out: Out = FOLDER,
    trap: Annotated[bool, typer.Option("--trap/--no-trap", help="then look at a black trap for stray light")] = True,
    stability: Annotated[float, typer.Option(min=0, max=600, help="minutes to watch the lamp's drift")] = 5.0,
    yes: Yes = False,
) -> None:
    """What the detector makes of light: dark, noise, linearity, ranges, drift, gain by a white reference, stray."""
    from gonio.commands.calibrate.calibrating import certificate_of, radiometry_by_reference

    with owned(rig, "radiometry", out) as owner:
        known = certificate_of(f, table, u, theta_i, theta_o)
        typer.echo(radiometry_by_reference(owner, out, known, ask(owner, yes), trap=trap, minutes=stability).text)


@app.command()
def verify(
    f: F = None,
    table: Table = None,
    u: U = 0.5,
    theta_i: ThetaI = 45.0,
    theta_o: ThetaO = 0.0,
    rig: RigOption = "sim",
    after: Annotated[float, typer.Option(min=0, max=1440, help="minutes until all is repeated; 0: not")] = 60.0,
    yes: Yes = False,
) -> None:
    """Whether the rig as calibrated can be believed: reciprocity, isotropy, energy, a known sample, a repeat."""
    from gonio.commands.calibrate.calibrating import certificate_of, verified

    with owned(rig) as owner:
        known = certificate_of(f, table, u, theta_i, theta_o)
        text, good = verified(owner, known, ask(owner, yes), after)
        typer.echo(text)
    if not good:
        raise typer.Exit(1)


@app.command("all")
def all_(
    f: F = None,
    table: Table = None,
    u: U = 0.5,
    theta_i: ThetaI = 45.0,
    theta_o: ThetaO = 0.0,
    rig: RigOption = "sim",
    out: Out = FOLDER,
    wedge: Annotated[float, typer.Option(min=0, max=30, help="degrees of the wedge under the mirror; 0: none")] = 15.0,
    stability: Annotated[float, typer.Option(min=0, max=600, help="minutes to watch the lamp's drift")] = 5.0,
    after: Annotated[float, typer.Option(min=0, max=1440, help="minutes until verify repeats; 0: not")] = 0.0,
    again: Annotated[bool, typer.Option("--again", help="begin anew; else what was done goes on")] = False,
    yes: Yes = False,
) -> None:
    """Geometry, radiometry, verify; after Ctrl-C or a fault the same command goes on. Writes a rig file to use."""
    from gonio.commands.calibrate.calibrating import certificate_of, everything

    config = rig_config(rig)
    known = certificate_of(f, table, u, theta_i, theta_o)
    with alone(config):
        good = everything(
            config, out, known, lambda owner: ask(owner, yes), wedge=wedge, minutes=stability, after=after, again=again
        )
    if not good:
        raise typer.Exit(1)


def _take(rig: str, picture: Path, poses: Path) -> None:
    import numpy as np

    from calibration.take_view import take_view

    with owned(rig) as owner:
        pose = take_view(owner.as_is(calibrated=False), picture, poses)
        at = "  ".join(f"{n} {a:.2f}" for n, a in zip(owner.config.axis_names, np.degrees(pose)))
    typer.echo(f"view   {picture}: {at} degrees, added to {poses}")


def _frames(rig: str, out: Path, flat: bool) -> None:
    from calibration.camera_frames import measure_frames

    with owned(rig) as owner:
        found = measure_frames(owner.as_is(calibrated=False), flat=flat)
    path = found.save(out)
    text = f"{len(found.exposures)} dark frames, {int(found.bad.sum())} bad pixels"
    if found.flat is not None:
        text += f", flat from {found.flat.min():.2f} to {found.flat.max():.2f}"
    typer.echo(f"frames  {text}\nfile  {path}: name it in the rig's YAML as calibration.frames")


def _save(found, folder: Path, text: str) -> None:
    from gonio.rig.calibration import save_calibration

    path = save_calibration(found, folder)
    typer.echo(f"{found.kind}  {text}\nfile  {path}: name it in the rig's YAML as calibration.{found.kind}")
