"""Emulated servos and the driver on their port."""

import numpy as np

from drivers.dynamixel.bus import Bus
from drivers.dynamixel.stage import COUNT, DynamixelStage
from gonio.config import load_config
from gonio.config.rig import RigConfig
from gonio.rig.build import axes_of
from gonio.rig.clock import ScaledClock
from sim.wire.line import Line, Server
from sim.wire.servo import Servo
from sim.wire.servo_bus import ServoBus
from tests.conftest import ROOT

WIRE = load_config(ROOT / "configs/rigs/wire.yaml", RigConfig)
AXES = axes_of(WIRE)
IDS = {a.name: k for k, a in enumerate(AXES, 1)}
SCALE = 2000.0


class Bench:
    def __init__(self, folder, scale=SCALE, **kwargs):
        self.clock = ScaledClock(scale)
        self.servos = {k: Servo(k, self.clock) for k in IDS.values()}
        self.bus = ServoBus(self.servos)
        self.line = Line(folder / "bus", self.bus)
        self.server = Server([self.line])
        names = {v: k for k, v in IDS.items()}
        driver = Bus(str(self.line.path), 1_000_000, names)
        self.stage = DynamixelStage(
            driver, AXES, IDS, "XM430-W350", np.zeros(4), self.clock, poll_s=0.02 * scale, **kwargs
        )

    def close(self):
        self.stage.close()
        self.server.close()


def pose(*counts):
    return np.array(counts) * COUNT
