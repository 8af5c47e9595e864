"""What a rig's YAML may say of its detector: a photodiode behind filters, or a camera."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from gonio.config.loader import Section

Vector = tuple[float, float, float]
Footprint = Literal["overfilled", "underfilled"]


class PhotodiodeConfig(Section):
    """Noise and range of the detector. Unit: its signal from a white diffuser lit and seen at the normal (f = 1/pi)."""

    shot_noise: float = Field(0.005, ge=0, le=1, description="relative, at signal 1; grows as the root of the signal")
    read_noise: float = Field(1e-4, ge=0, le=1, description="per reading")
    bits: int = Field(16, ge=1, le=32, description="of the converter; see `ranges`")
    ranges: int = Field(3, ge=1, le=8)
    range_factor: float = Field(30.0, gt=1, le=1e4)
    full_scale: float = Field(8.0, gt=0, description="of the lowest range")
    dark: float = Field(1e-3, description="signal without light")
    nonlinearity: float = Field(0.0, ge=-0.1, le=0.1, description="relative deviation at the full scale of a range")
    footprint: Footprint = Field(
        "overfilled", description="overfilled: the light covers more than the detector sees; underfilled: less"
    )
    target_sigma: float | None = Field(
        None, gt=0, le=1, description="readings are averaged until sigma is this share of the signal above dark"
    )
    target_sigma_floor: float = Field(
        1e-4, ge=0, le=1, description="and never finer than this, in units of the signal: dark ones need no share"
    )
    max_readings: int = Field(100, ge=1, le=10_000, description="that one average may take")
    average_s: float = Field(10.0, gt=0, description="seconds that one average may take")


class SensorConfig(Section):
    """A camera's sensor. The first two give sigma; the others are those of an emulated one."""

    electrons_per_count: float = Field(2.0, gt=0, le=1e4, description="at the gain used")
    read_noise: float = Field(3.0, ge=0, le=1e4, description="electrons per pixel and frame")
    bits: Literal[8, 10, 12, 14, 16] = 12
    white_per_s: float = Field(
        1.1e4, gt=0, le=1e12, description="electrons per second and pixel of a white diffuser at the normal (f = 1/pi)"
    )
    dark_per_s: float = Field(20.0, ge=0, description="electrons per second and pixel without light")
    offset: float = Field(16.0, ge=0, description="counts without light at no exposure")
    vignetting: float = Field(0.2, ge=0, lt=1, description="loss in the corners of the picture")
    hot_pixels: int = Field(5, ge=0, le=1000)
    delay_frames: int = Field(3, ge=0, le=16, description="frames under way when a setting changes")
    aim_deg: Vector = Field((0.0, 0.0, 0.0), description="how the camera is turned from where it should look")
    shift_mm: Vector = Field((0.0, 0.0, 0.0), description="and moved from where it should be")


class CameraConfig(Section):
    """A camera as the detector: its settings, and the part of its picture that counts.

    Signals are counts in the rig's nominal exposure. focal_px and distance_mm are those of the drawing; what counts is
    the file `calibration.camera`, where one is named.
    """

    exposure_s: tuple[Annotated[float, Field(ge=1e-4, le=10)], ...] = Field(
        (1e-4, 8e-4, 6.4e-3, 5.12e-2, 0.4096), min_length=1, max_length=12, description="ladder, shortest first"
    )
    gain: float = Field(0.0, ge=0)
    white_balance_k: int | None = Field(None, ge=1000, le=20000, description="colour temperature; null: not touched")
    channels: tuple[Annotated[int, Field(ge=0, le=15)], ...] = Field(
        (2, 1, 0), min_length=1, description="planes of a frame for the material's channels; OpenCV has blue first"
    )
    width: int = Field(1280, ge=16, le=16384)
    height: int = Field(720, ge=16, le=16384)
    frame_s: float = Field(1 / 30, gt=0, le=10, description="from one frame to the next, where exposures are shorter")
    discard_frames: int = Field(4, ge=1, le=64, description="thrown away after each move and change: under way before")
    deadline_s: float = Field(5.0, gt=0, le=600, description="without a settled frame, beyond what exposures need")
    region_mm: float = Field(4.0, gt=0, description="diameter of the patch of the sample that is looked at")
    lit_mm: float = Field(12.0, gt=0, description="diameter of the patch that the lamp lights")
    focal_px: float = Field(1600.0, gt=0)
    distance_mm: float = Field(200.0, gt=0, description="from the sample's middle")
    sensor: SensorConfig = SensorConfig()

    @model_validator(mode="after")
    def _in_order(self) -> "CameraConfig":
        if any(a >= b for a, b in zip(self.exposure_s, self.exposure_s[1:])):
            raise ValueError("exposure_s: each must be longer than the one before")
        if len(set(self.channels)) < len(self.channels):
            raise ValueError("channels: each plane once")
        return self

    @property
    def reading_s(self) -> float:
        """About how long one reading takes: two exposures of its ladder, as channels of unlike brightness need."""
        return 2 * (self.discard_frames + 1) * sum(max(self.frame_s, t) for t in self.exposure_s) / len(self.exposure_s)
