"""The drivers that ship, as `gonio.rig.driver.Driver`: made by the same door as plug-ins, from a rig's YAML."""

from collections.abc import Iterator
from typing import ClassVar

from drivers.dynamixel.bus import Bus
from drivers.dynamixel.doctor import examine
from drivers.dynamixel.stage import DynamixelStage
from drivers.grbl.controller import Controller
from drivers.grbl.doctor import examine as examine_controller
from drivers.grbl.stage import GrblStage
from drivers.light import SerialLight
from drivers.photodiode import Photodiode
from drivers.text.detector import GRACE_S, TextDetector
from drivers.text_line import TextLine
from gonio.config.devices import GrblConfig, InstrumentPortConfig, LampConfig, PhotodiodePort, ServoBusConfig
from gonio.config.instrument import TextSection
from gonio.config.plugins import DeviceSection
from gonio.rig.driver import Setting

POLL_S = 0.02  # machine seconds between two polls of servos on the move


class Dynamixel(DynamixelStage):
    Config: ClassVar[type[DeviceSection]] = ServoBusConfig

    def __init__(self, config: ServoBusConfig, setting: Setting):
        super().__init__(
            Bus(config.port, config.baud, {number: name for name, number in config.ids.items()}),
            setting.axes,
            config.ids,
            config.model,
            setting.park,
            setting.clock,
            watchdog_s=config.watchdog_s,
            after_fault=config.after_fault,
            poll_s=min(POLL_S, config.watchdog_s / 4) * getattr(setting.clock, "scale", 1.0),
        )

    def doctor(self) -> Iterator[str]:
        yield from examine(self)


class Grbl(GrblStage):
    Config: ClassVar[type[DeviceSection]] = GrblConfig

    def __init__(self, config: GrblConfig, setting: Setting):
        super().__init__(
            Controller(config.port, config.baud, config.boot_s),
            setting.axes,
            config.axes,
            setting.park,
            setting.clock,
            homing=config.homing,
            home_s=config.home_s,
            poll_s=config.poll_s * getattr(setting.clock, "scale", 1.0),
        )

    def doctor(self) -> Iterator[str]:
        yield from examine_controller(self)


class Lamp(SerialLight):
    Config: ClassVar[type[DeviceSection]] = LampConfig

    def __init__(self, config: LampConfig, setting: Setting):
        super().__init__(_line("light", config, setting), setting.clock, setting.rig.light.warm_up_s)

    def doctor(self) -> Iterator[str]:
        self.connect()
        yield "ok   light: answers, off"


class SerialPhotodiode(Photodiode):
    Config: ClassVar[type[DeviceSection]] = PhotodiodePort

    def __init__(self, config: PhotodiodePort, setting: Setting):
        super().__init__(_line("photodiode", config, setting), setting.rig.photodiode, setting.rig.exposure_s)

    def doctor(self) -> Iterator[str]:
        self.connect()
        yield f"ok   photodiode: answers, {len(self.full_scale)} ranges"


class Text(TextDetector):
    Config: ClassVar[type[DeviceSection]] = TextSection

    def __init__(self, config: TextSection, setting: Setting):
        grace_s = GRACE_S if setting.patient else 0.0
        super().__init__(config, setting.rig.photodiode, setting.rig.exposure_s, setting.clock, grace_s)


def _line(name: str, config: InstrumentPortConfig, setting: Setting) -> TextLine:
    patient = {} if setting.patient else {"grace_s": 0.0}
    return TextLine(name, config.port, config.baud, boot_s=config.boot_s, **patient)
