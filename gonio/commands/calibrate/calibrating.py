"""The calibrations that drive the rig, step by step: what has to lie on it, what is measured, what is saved."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer

from gonio.commands.calibrate import laid_down

if TYPE_CHECKING:
    from calibration.board import Board
    from calibration.geometry.session import Session
    from calibration.radiometry.certificate import Certificate
    from gonio.config.rig import RigConfig
    from gonio.daemon.rig_owner import RigOwner

WEAK = np.radians(0.2)  # a geometry known no better than this is hardly one
Ask = Callable[[str], object]  # what the operator has to put into the sample's place


@dataclass(frozen=True)
class Saved:
    """A calibration's file, and the lines that tell of it."""

    path: Path
    text: str


def geometry_by_mirror(owner: "RigOwner", folder: Path, wedge_deg: float, ask: Ask, *, force: bool = False) -> Saved:
    """Geometry from the peaks of a mirror, flat and on a wedge. Raises CalibrationMissing, SafetyStop, DeviceFault."""
    from calibration import pictures
    from calibration.geometry.fit import calibration_of, misses_of
    from calibration.geometry.observations import write_observations
    from calibration.geometry.session import Session
    from gonio.rig.calibration import save_calibration
    from gonio.rig.errors import CalibrationMissing

    config = owner.config
    a = np.radians(wedge_deg)
    wedges = (np.array([np.sin(a), 0.0, np.cos(a)]),) if wedge_deg else ()
    session = Session(config, wedges, _saying())
    lie = ["the flat mirror, lying as samples lie"]
    lie += [f"the mirror on a wedge of {wedge_deg:g} degrees, its normal towards the sample's x"] * bool(wedge_deg)
    try:
        for number, what in enumerate(lie):
            ask(what)
            session.measure(owner.as_is(laid_down.mirror(owner.config, wedge_deg * number), calibrated=False), number)
        session.confirm()
    except CalibrationMissing as e:
        if not (force and session.observations and "no rig explains" in str(e)):
            raise CalibrationMissing(f"{e}{_kept(session, folder)}") from None
        typer.echo(f"warning  {e}", err=True)
    except BaseException:
        typer.echo(_kept(session, folder).removeprefix("; "), err=True)
        raise
    fit = session.fit
    found = calibration_of(fit, config, config.depth != "real", session.held_out_rms)
    path = save_calibration(found, folder)
    write_observations(path.with_suffix(".csv"), session.observations, config)
    held = misses_of(session.held_out, fit)
    pictures.save(pictures.geometry(fit, session.observations, held), path.with_suffix(".png"))
    lines = [
        f"geometry  a direction is known to {np.degrees(fit.directions_sigma):.3f} degrees; "
        f"{len(session.observations)} peaks agree to {np.degrees(fit.rms):.3f}, "
        f"{len(held)} held out to {np.degrees(session.held_out_rms):.3f}",
        *(["warning  that is little: see what was not told"] if fit.directions_sigma > WEAK else []),
        *(f"not told  {line}" for line in _not_told(session)),
        f"file  {path}: name it in the rig's YAML as calibration.geometry",
    ]
    return Saved(path, "\n".join(lines))


def certificate_of(
    f: list[float] | None, table: Path | None, u_percent: float, theta_i: float, theta_o: float
) -> "Certificate":
    """What was said of the reference. Raises ConfigError, CalibrationMissing."""
    from calibration.radiometry.certificate import BRIGHTEST, Certificate, read_certificate
    from gonio.config import ConfigError

    if bool(f) == (table is not None):
        raise ConfigError("give the reference's f: --f once a channel, or --table CSV, and not both")
    if table is not None:
        return read_certificate(table, u_percent / 100)
    if wrong := [v for v in f or () if not 0 < v < BRIGHTEST]:
        raise ConfigError(
            f"--f {wrong[0]:g}: must lie between 0 and {BRIGHTEST:g} 1/sr; a white reference has about 0.31, "
            "which is its reflectance over pi"
        )
    return Certificate.of_one(theta_i, theta_o, np.array(f), u_percent / 100)


def radiometry_by_reference(
    owner: "RigOwner", folder: Path, known: "Certificate", ask: Ask, *, trap: bool, minutes: float
) -> Saved:
    """Radiometry from a reference, and a trap. Raises CalibrationMissing, SafetyStop, DeviceFault."""
    from calibration import pictures
    from calibration.radiometry.certificate import within_reach
    from calibration.radiometry.reference import calibrate_at
    from calibration.radiometry.session import Session
    from gonio.atomic import write_text
    from gonio.rig.calibration import save_calibration

    ask("the white reference")
    if owner.config.detector == "camera":  # it has no ranges, and its frames have darks of their own
        rig = owner.as_is(laid_down.reference(owner.config, known), calibrated=False)
        known.confirm_channels(rig.channels)
        near, _ = within_reach(known.part(np.arange(1)), rig.reachable)
        found = calibrate_at(rig, near.wi, near.wo, near.f[0], float(near.u[0]))
        found = found.model_copy(update={"reference": known.digest})
        path = save_calibration(found, folder)
    else:
        session = Session(known, _saying(), 60 * minutes)
        rig = owner.as_is(laid_down.reference(owner.config, known), calibrated=False)
        try:
            session.measure_white(rig)
            if trap:
                ask("a black trap, or nothing at all over a dark hole")
                rig = owner.as_is(laid_down.black(owner.config, rig.channels), calibrated=False)
                session.measure_trap(rig)
            found = session.result(rig)
        except BaseException:
            if session.points:
                kept = folder / "radiometry-unfinished.json"
                folder.mkdir(parents=True, exist_ok=True)
                write_text(kept, session.record())
                typer.echo(f"readings kept in {kept}", err=True)
            raise
        path = save_calibration(found, folder)
        pictures.save(pictures.radiometry(session, found), path.with_suffix(".png"))
    gains = ", ".join(f"{g:.4g} ± {s:.1g}" for g, s in zip(found.gain, found.gain_sigma))
    lines = [f"radiometry  gain {gains}, linearity {found.linearity:+.2%}"]
    if found.range_ratios:
        ratios = ", ".join(f"{r:.4f}" for r in found.range_ratios[1:])
        ranges = f"{ratios} of the lowest; " if ratios else "one; "
        lines += [
            f"ranges  {ranges}{found.curve_rms:.2%} are left over all decades",
            f"lamp    {found.drift_per_h:+.2%} ± {found.drift_per_h_sigma:.2%} an hour, "
            f"warm after {found.warm_up_s:.0f} s",
            f"noise   shot {found.shot_noise:.2g}, read {found.read_noise:.2g}{_noise_differs(owner, found)}",
        ]
    if found.stray:
        worst = max(s / g * np.pi for s, g in zip(found.stray, found.gain))
        lines.append(f"stray   {worst:.1e} of a white diffuser")
    lines.append(f"file  {path}: name it in the rig's YAML as calibration.radiometry")
    return Saved(path, "\n".join(lines))


def views_by_driving(owner: "RigOwner", board: "Board", count: int, folder: Path, ask: Ask) -> tuple[list[Path], Path]:
    """Pictures of a board taken by the rig's own camera at poses that tell most, and the table of these poses.

    Raises CalibrationMissing, SafetyStop, DeviceFault.
    """
    from calibration.board_views import take_views

    ask("the board, in the sample's middle, its face up")
    return take_views(
        owner.as_is(laid_down.board(owner.config, board), calibrated=False), board, count, folder, _saying()
    )


def verified(owner: "RigOwner", known: "Certificate | None", ask: Ask, minutes: float) -> tuple[str, bool]:
    """The verdict and a line for each check; whether all that were made hold."""
    from calibration.verify import verdict, verify

    ask("the white reference, or another matt sample that is known")
    reference = None if known is None else laid_down.reference(owner.config, known)
    rig = owner.as_is(reference)
    say = _saying()

    def wait() -> None:
        say(f"waiting {minutes:g} min for the repeat; the lamp stays on")
        rig.clock.sleep(60 * minutes)

    checks = verify(rig, known, wait if minutes else None, say)
    text = "\n".join([f"verdict  {verdict(checks)}", *(c.text for c in checks)])
    told = [c.passed for c in checks if c.passed is not None]
    return text, bool(told) and all(told)


def everything(
    config: "RigConfig",
    folder: Path,
    known: "Certificate",
    ask_of: "Callable[[RigOwner], Ask]",
    *,
    wedge: float,
    minutes: float,
    after: float,
    again: bool,
) -> bool:
    """Geometry, radiometry, verify, each with what was found before; whether verify holds. Goes on where it was
    left."""
    from gonio.commands.calibrate.calibrated import Calibrated
    from gonio.daemon.rig_owner import RigOwner

    state = Calibrated(config, folder, known.digest, again=again)
    if "geometry" not in state.done:
        with RigOwner(state.config) as owner:
            saved = geometry_by_mirror(owner, folder, wedge, ask_of(owner))
        typer.echo(saved.text)
        state.add("geometry", saved.path)
    else:
        typer.echo(f"geometry  done: {state.done['geometry']}")
    if "radiometry" not in state.done:
        with RigOwner(state.config) as owner:
            saved = radiometry_by_reference(owner, folder, known, ask_of(owner), trap=True, minutes=minutes)
        typer.echo(saved.text)
        state.add("radiometry", saved.path)
    else:
        typer.echo(f"radiometry  done: {state.done['radiometry']}")
    with RigOwner(state.config) as owner:
        text, good = verified(owner, known, ask_of(owner), after)
    typer.echo(text)
    typer.echo(f"rig   {state.path}: give it as --rig")
    return good


def _saying() -> Callable[[str], None]:
    """One line that is overwritten, where somebody looks."""
    live = sys.stderr.isatty()
    return lambda text: typer.echo(f"\r\x1b[K{text}", nl=False, err=True) if live else None


def _noise_differs(owner: "RigOwner", found) -> str:
    """A hint where the rig's YAML says otherwise than photon transfer."""
    said = owner.config.photodiode
    for key, seen in (("shot_noise", found.shot_noise), ("read_noise", found.read_noise)):
        value = getattr(said, key)
        if not 0.7 * value <= seen <= 1.4 * value + 1e-12:
            return f"; the rig's YAML says photodiode.{key} {value:.2g}: correct it, sigmas follow from it"
    return ""


def _kept(session: "Session", folder: Path) -> str:
    """Peaks of a session that came to nothing, kept in a table; a phrase that says where, "" where there are none."""
    from calibration.geometry.observations import write_observations

    if not session.observations:
        return ""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "geometry-unfinished.csv"
    write_observations(path, session.observations, session.config)
    return f"; peaks kept in {path}"


def _not_told(session: "Session") -> list[str]:
    """What a mirror cannot tell, and what would."""
    harmless = [n for n in session.untold if session.only_turns(n)]
    lines = [
        f"the zero of {n.split('.')[1]}: a mark on the sample would, as `light` in a CSV of what was seen"
        for n in harmless
        if n.startswith("offset.")
    ]
    kinds = sorted({n.rsplit(".", 1)[0] if n.count(".") > 1 else n for n in session.untold if n not in harmless})
    few = ", ".join(kinds[:6]) + (" ..." if len(kinds) > 6 else "")
    if kinds and session.fit.directions_sigma <= WEAK:
        lines.append(f"{few}: each alone; what they do to directions together is told")
    elif kinds:
        wedge = (
            "the mirror on a wedge would, --wedge 15"
            if not session.parameters.mirrors
            else "wider limits of the axes would"
        )
        lines.append(f"{few}: {wedge}")
    return lines
