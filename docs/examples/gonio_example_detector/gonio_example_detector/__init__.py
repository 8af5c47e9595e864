"""A spectrometer as a rig's detector: {driver: example_spectrometer, host: ..., port: ..., bands: {...}}."""

from collections.abc import Iterator
from typing import Any, Literal

import numpy as np
from pydantic import Field

from gonio.config.bands import Bands
from gonio.config.plugins import DetectorSection
from gonio.rig.devices import Reading
from gonio.rig.driver import Setting
from gonio.rig.errors import DeviceFault
from gonio_example_detector.protocol import FULL, Link


class SpectrometerConfig(DetectorSection):
    driver: Literal["example_spectrometer"] = "example_spectrometer"
    host: str
    tcp_port: int = Field(ge=1, le=65535)
    white: float = Field(20_000.0, gt=0, description="counts of a white diffuser at the normal")
    bands: Bands

    @property
    def channels(self) -> int:
        return len(self.bands.bands_nm)


class Spectrometer:
    Config = SpectrometerConfig

    def __init__(self, config: SpectrometerConfig, setting: Setting):
        self.config, self.exposure, self.noise = config, setting.rig.exposure_s, setting.rig.photodiode
        self.link, self.channels = Link(config.host, config.tcp_port), config.channels

    def connect(self) -> None:
        self._guarded(self.link.open)

    def close(self) -> None:
        self.link.close()

    def expect(self, signal: Any) -> None:
        """It has one range."""

    def read(self, exposure: float | None = None) -> Reading:
        seconds = exposure or self.exposure
        counts = self._guarded(lambda: self.link.spectrum(seconds, len(self.config.bands.wavelengths)))
        value = self.config.bands.binned(counts.astype(float)) / self.config.white
        sigma = np.hypot(self.noise.shot_noise * np.sqrt(np.maximum(value, 0)), self.noise.read_noise)
        return Reading(value, sigma, bool((counts >= FULL).any()), {"exposure_s": seconds, "peak": int(counts.max())})

    def doctor(self) -> Iterator[str]:
        self.connect()
        yield f"ok   spectrometer: peak of {self.read().raw['peak']} counts of {FULL}"

    def _guarded(self, act: Any) -> Any:
        try:
            return act()
        except (OSError, ValueError) as e:
            raise DeviceFault("spectrometer", str(e) or "no reply", "check its network cable and supply") from None
