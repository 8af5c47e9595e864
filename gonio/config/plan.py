"""How the rig plans its motion. Every saving is a switch, so that a bench can show what it is worth."""

from typing import Literal

from pydantic import Field

from gonio.config.loader import Section


class PlanConfig(Section):
    """Motion is 80 % of a run; each key is one way to have less of it."""

    branches: bool = Field(True, description="take the cheapest of all equivalent poses")
    tour: bool = Field(True, description="visit a batch in the order of least travel")
    window: int = Field(512, ge=2, le=4096, description="pairs that one tour orders; a longer batch is cut up")
    free_azimuth: bool = Field(True, description="isotropic samples only: any turntable angle, either mirror image")
    reciprocity: bool = Field(False, description="the arms may be swapped; only where it has been shown to hold")
    one_sided: Literal["never", "needed", "always"] = Field(
        "needed",
        description="approach from below on axes that have backlash and where it moves a direction",
    )
    overlap: bool = Field(False, description="start the next motion before the last reading is stored")
    predict_range: bool = Field(True, description="choose the detector's range by what is expected, not by trial")
    dark_every: int = Field(500, ge=1, description="measurements that share one dark reading")
    look_every: int | None = Field(
        None,
        ge=0,
        description="measurements between two looks whether lamp, dark and detector are as they were; 0: never; "
        "null: 160 on rigs of real drivers, never on others",
    )
    fly: bool | None = Field(
        None, description="read while the arms move, for the reconstruction; null: where the rig can"
    )
    fly_rate: float = Field(200.0, gt=0, le=2000, description="readings a second while the arms move")
    reference_every: int = Field(0, ge=0, description="measurements between two looks at the reference point; 0: never")
