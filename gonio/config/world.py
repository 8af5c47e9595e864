"""What is wrong with a simulated rig and nobody is told: the section `world` of a rig's YAML.

Read by `sim` alone. Nothing that plans, drives, reduces or reconstructs may look at it: a calibration has to find it.
"""

from typing import Annotated

from pydantic import Field

from gonio.config.loader import Section

Angle = Annotated[float, Field(ge=-20, le=20)]
Small = Annotated[float, Field(ge=0, le=5)]
Millimetres = Annotated[float, Field(ge=-50, le=50)]


class World(Section):
    """Keys by axis name the rig's axes; what is not given is 0, or drawn where there is a seed."""

    seed: int | None = Field(None, ge=0, le=2**63 - 1, description="draws all that is not given")
    offsets_deg: dict[str, Angle] | None = Field(None, description="encoder at the joint's zero, beyond offset_deg")
    tilts_deg: dict[str, tuple[Angle, Angle]] | None = Field(None, description="of an axis, about two directions")
    backlash_deg: dict[str, Small] | None = Field(None, description="beyond the axis's own backlash_deg")
    eccentricity_deg: dict[str, tuple[Small, Small]] | None = Field(
        None, description="first and second harmonic of the encoder's turn"
    )
    axes_miss_mm: dict[str, tuple[Millimetres, Millimetres, Millimetres]] | None = Field(
        None, description="how far the centre of the arm of `light` and of `detector` lies beside the sample"
    )
    arm_mm: float = Field(400.0, ge=50, le=10_000, description="from the sample to light and detector")
    sample_tilt_deg: tuple[Angle, Angle] | None = Field(None, description="of its normal, about x and y")
    sample_height_mm: Millimetres | None = Field(None, description="above the axes")
    beam_deg: dict[str, tuple[Angle, Angle]] | None = Field(
        None, description="where `light` shines and `detector` looks, beside the sample"
    )
    beam_width_deg: float = Field(3.0, gt=0, le=90, description="sd of the beams, Gaussian")
    gain: tuple[float, ...] | None = Field(None, description="a factor of all signals, one or one a channel")
    range_ratios: tuple[float, ...] | None = Field(None, description="factors of the ranges above the lowest")
    nonlinearity: float | None = Field(None, ge=-0.5, le=0.5, description="relative excess at full scale")
    drift_per_h: float | None = Field(None, ge=-1, le=1, description="of the lamp, relative")
    dark_per_k: float | None = Field(None, ge=-10, le=10, description="of the dark signal, relative")
    room_k: float = Field(1.5, ge=0, le=50, description="half the swing of the room's temperature in a day of 8 h")
    stray: float | None = Field(None, ge=0, le=1, description="light that reaches the detector in any pose, of white")
    polarisation: float | None = Field(
        None, ge=0, le=1, description="degree of both light and detector, across their arms"
    )
