"""Dark and flat frames and bad pixels of a camera: a file that `gonio calibrate camera` writes and a rig refers to."""

import datetime as dt
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gonio.atomic import replacing
from gonio.brdf.saved import read_arrays
from gonio.geometry import Array
from gonio.rig.errors import CalibrationMissing


@dataclass(frozen=True)
class Frames:
    """exposures (E,) seconds; dark (E, H, W, P) counts, each a mean of `averaged`; bad (H, W).

    flat (H, W, P), 1 in the middle, None = the picture counts as even. id, date: None where not from a file.
    """

    exposures: tuple[float, ...]
    dark: Array
    averaged: int
    bad: NDArray[np.bool_]
    flat: Array | None = None
    id: str | None = None
    date: str | None = None

    def save(self, folder: Path) -> Path:
        """Write `<id>.npz` into the folder (made if needed), all or nothing; its path."""
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{self.id}.npz"
        held = {
            "exposures": np.array(self.exposures), "dark": self.dark.astype(np.float32), "bad": self.bad,
            "averaged": np.array(self.averaged), "id": np.array(str(self.id)), "date": np.array(str(self.date)),
        }  # fmt: skip
        if self.flat is not None:
            held["flat"] = self.flat.astype(np.float32)
        with replacing(path) as file:
            np.savez_compressed(file, allow_pickle=False, **held)
        return path


def load_frames(path: Path, exposures: tuple[float, ...], size: tuple[int, int], max_age_days: float | None) -> Frames:
    """The frames of a file, made for this ladder and pictures of size (width, height).

    Raises CalibrationMissing where there are none, they are damaged, too old or made for something else.
    """
    again = "make them anew with `gonio calibrate camera --frames`"
    try:
        file = read_arrays(path)
        flat = file["flat"].astype(float) if "flat" in file else None
        found = Frames(
            tuple(file["exposures"].tolist()), file["dark"].astype(float), int(file["averaged"]),
            file["bad"].astype(bool), flat, str(file["id"]), str(file["date"]),
        )  # fmt: skip
        age = dt.datetime.now(dt.UTC) - dt.datetime.fromisoformat(str(found.date))
    except FileNotFoundError:
        raise CalibrationMissing(f"{path}: no such file; {again}") from None
    except (OSError, ValueError, KeyError, TypeError) as e:
        raise CalibrationMissing(f"{path}: cannot be read ({type(e).__name__}); {again}") from None
    if found.exposures != exposures:
        raise CalibrationMissing(f"{path}: made for other exposures than camera.exposure_s; {again}")
    shape = (len(exposures), size[1], size[0])
    flat_fits = flat is None or flat.shape[:2] == shape[1:]
    if found.dark.shape[:3] != shape or found.bad.shape != shape[1:] or not flat_fits:
        raise CalibrationMissing(f"{path}: made for pictures of another size; {again}")
    if max_age_days is not None and age > dt.timedelta(days=max_age_days):
        raise CalibrationMissing(f"{path}: {age.days} days old, the rig allows {max_age_days:g}; {again}")
    return found
