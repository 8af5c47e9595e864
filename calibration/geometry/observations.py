"""What a rig was seen to show at encoder poses; as a table, `kind, <axis>_deg of every axis, x, y, z`.

Three kinds, whichever the lab can make:

    mirror     a flat mirror in the sample's place throws the light into the detector: the half vector is its normal
    detector   the camera on the detector arm sees a board in the sample's place: wo in the sample's frame
    light      a polished ball or the board's shadow gives wi in the sample's frame

Columns that may be added: `down`, names of axes last driven downwards (else upwards); `mirror`, 0 for one that lies as
the sample does, 1 and on for others; `sigma_deg` of the direction seen.
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calibration.rows import number, read_rows
from gonio.atomic import write_text
from gonio.config.rig import RigConfig
from gonio.geometry import Array, unit
from gonio.rig.errors import CalibrationMissing

KINDS = ("mirror", "detector", "light")


@dataclass(frozen=True)
class Observation:
    """What was seen at an encoder pose (A,) rad: `direction` (3,) in the sample's frame, None for a mirror.

    sigma: of the direction, rad, None = as the whole table. down (A,): axes that came from above, so that backlash
    shows. mirror: which one.
    """

    kind: Literal["mirror", "detector", "light"]
    pose: Array
    direction: Array | None = None
    sigma: float | None = None
    down: NDArray[np.bool_] | None = None
    mirror: int = 0


def write_observations(path: Path, observations: Sequence[Observation], config: RigConfig) -> None:
    """The table of `read_observations`."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["kind", *(f"{n}_deg" for n in config.axis_names), "x", "y", "z", "down", "mirror", "sigma_deg"])
    for o in observations:
        seen = ("", "", "") if o.direction is None else tuple(f"{v:.9f}" for v in o.direction)
        down = "" if o.down is None else " ".join(n for n, d in zip(config.axis_names, o.down) if d)
        sigma = "" if o.sigma is None else f"{np.degrees(o.sigma):.6f}"
        rows.writerow([o.kind, *(f"{a:.6f}" for a in np.degrees(o.pose)), *seen, down, o.mirror, sigma])
    write_text(path, text.getvalue())


def read_observations(path: Path, config: RigConfig) -> list[Observation]:
    """The observations of a CSV file. Raises CalibrationMissing that names file, line and column."""
    needed = ["kind", *(f"{name}_deg" for name in config.axis_names)]
    rows = read_rows(path, needed, f"{', '.join(needed)}, x, y, z")
    return [_observation(row, config, where) for where, row in rows]


def _observation(row: dict[str, str], config: RigConfig, where: str) -> Observation:
    kind = row["kind"]
    if kind not in KINDS:
        raise CalibrationMissing(f"{where}: kind is {kind!r}; it must be one of {', '.join(KINDS)}")
    pose = np.radians([number(row, f"{name}_deg", where) for name in config.axis_names])
    names = (row.get("down") or "").split()
    if unknown := [n for n in names if n not in config.axis_names]:
        raise CalibrationMissing(f"{where}: down names {unknown[0]!r}; axes are {', '.join(config.axis_names)}")
    down = np.array([n in names for n in config.axis_names])
    sigma = np.radians(number(row, "sigma_deg", where)) if row.get("sigma_deg") else None
    if sigma is not None and not sigma > 0:
        raise CalibrationMissing(f"{where}: sigma_deg is {row['sigma_deg']}; give one above 0")
    if kind == "mirror":
        mirror = number(row, "mirror", where) if row.get("mirror") else 0.0
        if mirror not in range(10):
            raise CalibrationMissing(f"{where}: mirror is {row['mirror']}; number them from 0 to 9")
        return Observation("mirror", pose, None, sigma, down, int(mirror))
    seen = np.array([number(row, column, where) for column in "xyz"])
    if not np.linalg.norm(seen) > 1e-9:
        raise CalibrationMissing(f"{where}: x, y, z are all 0; give a direction")
    direction = unit(seen)
    return Observation("detector" if kind == "detector" else "light", pose, direction, sigma, down)
