"""The calibrations that drive the rig, step by step: what has to lie on it, what is measured, what is saved."""

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import typer

if TYPE_CHECKING:
    from calibration.geometry.session import Session
    from gonio.daemon.rig_owner import RigOwner

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

    config, live = owner.config, sys.stderr.isatty()
    a = np.radians(wedge_deg)
    wedges = (np.array([np.sin(a), 0.0, np.cos(a)]),) if wedge_deg else ()
    session = Session(config, wedges, lambda text: typer.echo(f"\r{text}", nl=False, err=True) if live else None)
    lie = ["the flat mirror, lying as samples lie"]
    lie += [f"the mirror on a wedge of {wedge_deg:g} degrees, its normal towards the sample's x"] * bool(wedge_deg)
    try:
        for number, what in enumerate(lie):
            ask(what)
            session.measure(owner.as_is(_mirror(owner, wedge_deg * number), calibrated=False), number)
        session.confirm()
    except CalibrationMissing as e:
        if not session.observations:
            raise
        kept = folder / "geometry-refused.csv"  # nothing measured is lost
        folder.mkdir(parents=True, exist_ok=True)
        write_observations(kept, session.observations, config)
        if not force or "no rig explains" not in str(e):
            raise CalibrationMissing(f"{e}; peaks kept in {kept}") from None
        typer.echo(f"warning  {e}", err=True)
    fit = session.fit
    found = calibration_of(fit, config, config.depth != "real", session.held_out_rms)
    path = save_calibration(found, folder)
    write_observations(path.with_suffix(".csv"), session.observations, config)
    held = misses_of(session.held_out, fit)
    pictures.save(pictures.geometry(fit, session.observations, held), path.with_suffix(".png"))
    lines = [
        f"geometry  a direction is known to {np.degrees(fit.directions_sigma):.3f} degrees; {len(session.observations)} peaks "
        f"agree to {np.degrees(fit.rms):.3f}, {len(held)} held out to {np.degrees(session.held_out_rms):.3f}",
        *(f"not told  {line}" for line in _not_told(session)),
        f"file  {path}: name it in the rig's YAML as calibration.geometry",
    ]
    return Saved(path, "\n".join(lines))


def _mirror(owner: "RigOwner", wedge_deg: float):
    """What lies on a simulated rig; None on a real one."""
    if owner.config.depth == "real":
        return None
    from sim.mirror import Mirror

    return Mirror.on_wedge(wedge_deg) if wedge_deg else Mirror()


def _not_told(session: "Session") -> list[str]:
    """What a mirror cannot tell, and what would."""
    untold, lines = session.untold, []
    turning = [n for n in untold if n.startswith("offset.") and np.degrees(untold[n]) > 1]
    for name in turning:
        axis = name.split(".")[1]
        lines.append(
            f"the zero of {axis} ({np.degrees(untold[name]):.0f} degrees): a mark on the sample would, as `light` in a CSV"
        )
    rest = [n for n in untold if n not in turning]
    if rest:
        kinds = sorted({n.rsplit(".", 1)[0] for n in rest})
        few = ", ".join(kinds[:6]) + (" ..." if len(kinds) > 6 else "")
        lines.append(f"{few}: each alone; what they do to directions together is told")
    if not session.parameters.mirrors:
        lines.append("how both arms err alike, and the detector's azimuth on its way round: --wedge 15 would")
    return lines
