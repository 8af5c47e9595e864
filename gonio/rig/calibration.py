"""Calibration files: what `gonio calibrate` writes and a rig refers to. Dated, with an id that every run records."""

import datetime as dt
import math
from pathlib import Path
from typing import Literal, TypeVar

import yaml
from pydantic import Field, model_validator

from gonio.atomic import write_text
from gonio.config.loader import ConfigError, Section, load_config
from gonio.rig.errors import CalibrationMissing

Triple = tuple[float, float, float]


class Dated(Section):
    """What every calibration says of itself. id = kind, date and a few digits of what it holds; made_for: a digest of
    the parts of the rig's YAML that it hangs on; temperature_c: of the room."""

    id: str
    date: dt.datetime
    rig: str
    simulated: bool = False
    made_for: str | None = None
    temperature_c: float | None = None


class GeometryCalibration(Dated):
    """How a rig differs from its drawing; what is not given is as drawn.

    offsets_deg: encoder angle at each joint's zero. axes: (3,) of joints that are not as nominal. eccentricity_deg: of
    an encoder, sine and cosine of one turn and of two (`kinematics/encoders.py`). backlash_deg: beyond the axis's own.
    centres: how far the centres of the `light`'s and the `detector`'s arm lie beside the sample's axes, in the lab, and
    height: of the sample above them, in arm lengths. lie_deg: rotation vector about x and y from the drawn normal to
    the sample's. parameters, covariance: all of this as fitted, in radians and arm lengths, for `gonio budget`.
    """

    kind: Literal["geometry"] = "geometry"
    offsets_deg: dict[str, float] = Field(default_factory=dict)
    offsets_sigma_deg: dict[str, float] = Field(default_factory=dict)
    axes: dict[str, Triple] = Field(default_factory=dict)
    eccentricity_deg: dict[str, tuple[float, float, float, float]] = Field(default_factory=dict)
    backlash_deg: dict[str, float] = Field(default_factory=dict)
    centres: dict[Literal["light", "detector"], Triple] = Field(default_factory=dict)
    height: float = 0.0
    lie_deg: tuple[float, float] = (0.0, 0.0)
    residual_deg: float = 0.0
    held_out_deg: float | None = None
    directions_sigma_deg: float | None = None
    parameters: dict[str, float] = Field(default_factory=dict)
    covariance: tuple[tuple[float, ...], ...] = ()

    @model_validator(mode="after")
    def _possible(self) -> "GeometryCalibration":
        for name, axis in self.axes.items():
            if not 1e-6 < math.hypot(*axis) < math.inf:
                raise ValueError(f"axes.{name}: must not be the zero vector")
        size = len(self.parameters)
        if self.covariance and any(len(row) != size for row in (self.covariance, *self.covariance)):
            raise ValueError(f"covariance: must be {size} x {size}, as many as there are parameters")
        return self


class RadiometryCalibration(Dated):
    """gain per channel = signal per second of f = 1 at full projection; linearity = relative excess at full scale.

    dark, stray: signal a second without light, and with the lamp on and nothing to see; dark_offset: at no exposure.
    range_ratios: of each range to the lowest. gain_sigma holds the certificate's u (relative, k = 1). shot_noise of a
    signal of 1 and read_noise as seen by photon transfer; curve_rms: what is left of four decades, relative.
    """

    kind: Literal["radiometry"] = "radiometry"
    detector: str = "photodiode"  # or camera, or the name of another driver
    gain: tuple[float, ...]
    gain_sigma: tuple[float, ...]
    dark: tuple[float, ...] = ()
    linearity: float = 0.0
    linearity_sigma: float = 0.0
    dark_offset: tuple[float, ...] = ()
    range_ratios: tuple[float, ...] = ()
    range_ratios_sigma: tuple[float, ...] = ()
    stray: tuple[float, ...] = ()
    stray_sigma: tuple[float, ...] = ()
    drift_per_h: float = 0.0
    drift_per_h_sigma: float = 0.0
    warm_up_s: float = 0.0
    shot_noise: float | None = None
    read_noise: float | None = None
    curve_rms: float | None = None
    certificate_u: float = 0.0
    reference: str | None = Field(None, description="digest of what was said of the reference")

    @model_validator(mode="after")
    def _possible(self) -> "RadiometryCalibration":
        if not all(0 < g < math.inf for g in self.gain):
            raise ValueError("gain: must be above 0 in every channel")
        for name in ("gain_sigma", "stray", "stray_sigma"):
            values = getattr(self, name)
            if values and len(values) != len(self.gain):
                raise ValueError(f"{name}: {len(values)} numbers for {len(self.gain)} channels")
            if not all(math.isfinite(v) for v in values):
                raise ValueError(f"{name}: must be finite numbers")
        if not all(0.1 < r < 10 for r in self.range_ratios):
            raise ValueError("range_ratios: must lie between 0.1 and 10")
        return self


class CameraCalibration(Dated):
    """Pinhole matrix, distortion (OpenCV order), size in pixels, and the reprojection error in pixels.

    mount: rotation vector (rad) and place (metres) of the sample as the camera sees it with every joint at 0.
    """

    kind: Literal["camera"] = "camera"
    matrix: tuple[Triple, Triple, Triple]
    distortion: tuple[float, ...]
    size: tuple[int, int]
    rms_px: float
    views: int
    mount_rotation: Triple | None = None
    mount_m: Triple | None = None
    mount_rms_px: float | None = None


Calibration = TypeVar("Calibration", bound=Dated)


def load_calibration(path: Path, model: type[Calibration]) -> Calibration:
    """The calibration of a file, stale or not. Raises CalibrationMissing where there is none, or it is damaged."""
    if not path.is_file():
        raise CalibrationMissing(f"{path}: no such calibration; make it with `gonio calibrate`")
    try:
        return load_config(path, model)
    except ConfigError as e:
        raise CalibrationMissing(f"{e}; make it anew with `gonio calibrate`") from None


def save_calibration(calibration: Dated, folder: Path) -> Path:
    """Write `<id>.yaml` into the folder (made if needed), all or nothing; its path."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{calibration.id}.yaml"
    write_text(path, yaml.safe_dump(calibration.model_dump(mode="json"), sort_keys=False))
    return path
