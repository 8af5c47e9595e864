"""What a rig's YAML may say of where its devices are."""

from typing import Annotated, Literal

from pydantic import Field, SerializeAsAny

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


class ServoBusConfig(StageSection, PortConfig):
    """Dynamixel servos on one bus: axis name -> servo id. Torque after a fault: held or released."""

    driver: Literal["dynamixel"] = "dynamixel"
    baud: int = Field(1_000_000, ge=1200, le=10_000_000)
    ids: dict[str, Annotated[int, Field(ge=0, le=252)]]
    model: Literal["XM430-W350", "XM430-W210", "XL430-W250", "XH430-W350"] = "XM430-W350"
    after_fault: Literal["hold", "release"] = "hold"
    watchdog_s: float = Field(0.5, ge=0.02, le=2.54)


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
