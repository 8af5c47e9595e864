"""The emulators of one rig, on pseudo-terminals. The real drivers open `devices` and never know the difference."""

from functools import lru_cache

import numpy as np

from gonio.config.devices import DevicesConfig, InstrumentPortConfig, LampConfig
from gonio.config.instrument import TextSection
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import backlash_of, envelope_of, geometry_calibration, park_pose
from gonio.rig.clock import ScaledClock
from sim.light import SimLight
from sim.sample import Sample
from sim.wire.arms import Servos, arms_of
from sim.wire.folder import Folder
from sim.wire.instruments import instrument
from sim.wire.light import WireLight
from sim.wire.line import Device, Line, Server
from sim.wire.meter import Meter
from sim.wire.photodiode import WirePhotodiode
from sim.world import TrueRig


class Emulators:
    """Servos, lamp, and photodiode or another instrument, that show `sample`; `devices` and `config` say on which
    ports."""

    def __init__(self, config: RigConfig, sample: Sample, seed: int):
        self.clock = ScaledClock(config.clock_scale)
        envelope = envelope_of(config, geometry_calibration(config))
        rest = np.degrees(envelope.snap(park_pose(config)))
        true = None if config.world is None else TrueRig(config, sample.channels)
        lag = backlash_of(config, geometry_calibration(config)) if true is None else true.backlash
        backlash = np.degrees(lag).tolist()
        self.arms = arms_of(config, rest, backlash, self.clock)
        self.servos = self.arms.servos if isinstance(self.arms, Servos) else {}
        lamp = SimLight(config.light, self.clock)

        def shown(*pose_deg: float) -> Array:
            share = 1.0
            if true is None:
                wi, wo = envelope.kinematics.forward(np.radians(pose_deg))
            else:
                wi, wo, share = true.seen(np.radians(pose_deg))
            cosine = wi[2] if config.photodiode.footprint == "overfilled" else wo[2]
            return np.pi * share * max(cosine, 0.0) * sample.eval(wi[None], wo[None])[0]

        began = self.clock.now()
        shown = lru_cache(2)(shown)  # several readings are made of one pose: ranges tried, darks

        def scene() -> Array:
            power = self.light.power()
            if power == 0:
                return np.zeros(sample.channels)
            light = power * shown(*self.arms.angles_deg())
            return light if true is None else true.signal(light, self.clock.now() - began, power)

        self.photodiode = WirePhotodiode(
            config.photodiode, scene, sample.channels, config.exposure_s, seed, self.clock, true
        )
        self.bus, self.light = self.arms.device, WireLight(lamp)
        self.meter = self.instrument = None
        if isinstance(config.detector, TextSection):
            self.meter = Meter(config.photodiode, scene, config.detector.white, seed, self.clock, config.exposure_s)
            self.instrument = instrument(config.detector.instrument.name, self.meter)
        self._folder = Folder()
        self.folder = self._folder.path
        devices: dict[str, Device] = {"stage": self.bus, "photodiode": self.photodiode, "light": self.light}
        if self.instrument is not None:
            devices["instrument"] = self.instrument
        self.lines = {name: Line(self.folder / name, device) for name, device in devices.items()}
        self.server = Server(list(self.lines.values()))
        port = {name: str(line.path) for name, line in self.lines.items()}
        self.devices = DevicesConfig(
            stage=self.arms.section.model_copy(update={"port": port["stage"]}),
            photodiode=InstrumentPortConfig(port=port["photodiode"]),
            light=LampConfig(port=port["light"]),
        )

        self.config = config
        if isinstance(config.detector, TextSection):
            detector = config.detector.model_copy(update={"port": port["instrument"]})
            self.config = config.model_copy(update={"detector": detector})

    def angles_deg(self) -> list[float]:
        """Where the arms really are."""
        with self.server.lock:
            return self.arms.angles_deg()

    def announce(self, number: int) -> None:
        """The measurement that the next readings are for: their noise follows from it."""
        (self.meter or self.photodiode).announce(number)

    def state(self) -> dict[str, float]:
        """Where the shafts are: real ones stay there when the host dies."""
        with self.server.lock:
            return self.arms.state()

    def restore(self, state: dict[str, float]) -> None:
        with self.server.lock:
            self.arms.restore(state)

    def close(self) -> None:
        self.server.close()
        self._folder.close()
