"""What a rig's YAML may say of where its devices are."""

import re
from typing import Annotated, Literal

from pydantic import Field, SerializeAsAny, field_validator, model_validator

from gonio.config.loader import Section
from gonio.config.plugins import DetectorSection, LightSection, StageSection


class PortConfig(Section):
    """A serial device by its stable USB id (/dev/serial/by-id/...)."""

    port: str = Field(min_length=1)
    baud: int = Field(115200, ge=1200, le=10_000_000)


class InstrumentPortConfig(PortConfig):
    """An instrument that speaks text. One that answers at once is not waited for."""

    boot_s: float = Field(3.0, ge=0, le=120, description="how long it may be deaf after its port is opened")


class PhotodiodePort(DetectorSection, InstrumentPortConfig):
    """A photodiode that speaks the text protocol of `drivers/photodiode.py`: `devices.photodiode` in one piece."""

    driver: Literal["photodiode"] = "photodiode"


class LampConfig(LightSection, InstrumentPortConfig):
    """A lamp that speaks the text protocol of `drivers/light.py`."""

    driver: Literal["lamp"] = "lamp"


SERVOS = (
    "XM430-W350", "XM430-W210", "XL430-W250", "XH430-W350", "XL330-M077", "XL330-M288", "XC330-M181", "XC330-M288",
    "XC330-T181", "XC330-T288", "XC430-W150", "XC430-W240", "XM540-W150", "XM540-W270",
)  # fmt: skip
PROTOCOL_1 = re.compile(r"(AX|RX|DX|EX|MX)-?\d+\w?", re.IGNORECASE)


class ServoBusConfig(StageSection, PortConfig):
    """Dynamixel servos on one bus: axis name -> servo id. Torque after a fault: held or released."""

    driver: Literal["dynamixel"] = "dynamixel"
    baud: int = Field(1_000_000, ge=1200, le=10_000_000)
    ids: dict[str, Annotated[int, Field(ge=0, le=252)]]
    model: str = Field("XM430-W350", description="one of SERVOS")
    after_fault: Literal["hold", "release"] = "hold"
    watchdog_s: float = Field(0.5, ge=0.02, le=2.54)

    @field_validator("model")
    @classmethod
    def _driven(cls, v: str) -> str:
        if PROTOCOL_1.fullmatch(v):
            raise ValueError(f"servo {v} speaks protocol 1.0, which is not driven; take one of {', '.join(SERVOS)}")
        if v not in SERVOS:
            raise ValueError(f"expected one of {', '.join(SERVOS)}")
        return v

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(self.ids)


class GrblAxis(Section):
    """One axis of a controller: degrees are its units, machine = zero_deg + angle (- angle, if reversed)."""

    letter: Literal["X", "Y", "Z", "A", "B", "C"]
    zero_deg: float = Field(0.0, ge=-3600, le=3600, description="machine position at the joint's zero")
    reversed: bool = False


class GrblConfig(StageSection, PortConfig):
    """Stepper motors behind Grbl 1.1, FluidNC or grblHAL: axis name -> its letter there."""

    driver: Literal["grbl"] = "grbl"
    axes: dict[str, GrblAxis]
    homing: bool = Field(True, description="drive to the switches ($H) at each start; false: it has none")
    home_s: float = Field(120.0, gt=0, le=3600, description="that homing may take")
    boot_s: float = Field(3.0, ge=0, le=120, description="how long it may be deaf after its port is opened")
    poll_s: float = Field(0.05, ge=0.005, le=1)

    @property
    def joints(self) -> tuple[str, ...]:
        return tuple(self.axes)

    @model_validator(mode="after")
    def _each_once(self) -> "GrblConfig":
        letters = [a.letter for a in self.axes.values()]
        if len(set(letters)) < len(letters):
            raise ValueError("axes: each letter once")
        return self


class CameraDeviceConfig(Section):
    """A V4L2 camera by its stable USB id (/dev/v4l/by-id/...). Uncompressed formats only: MJPEG is lossy and bent."""

    device: str = Field(min_length=1)
    format: Literal["YUYV", "GREY", "Y16 "] = "YUYV"


class DevicesConfig(Section):
    """Where the devices of a real rig are. A rig of depth `wire` finds its emulators by itself."""

    stage: SerializeAsAny[StageSection] | None = None
    photodiode: InstrumentPortConfig | None = None
    light: SerializeAsAny[LightSection] | None = None
    camera: CameraDeviceConfig | None = None

    @property
    def ports(self) -> tuple[str, ...]:
        """What no other process may use meanwhile."""
        found = [p for d in (self.stage, self.light) if d is not None for p in d.ports]
        found += [self.photodiode.port] if self.photodiode else []
        return (*found, *([self.camera.device] if self.camera else []))
