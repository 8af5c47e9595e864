"""What moves an emulated rig: servos on a bus, or steppers behind a controller. Where their shafts are, and stay."""

import numpy as np

from gonio.config.devices import GrblConfig, ServoBusConfig
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.clock import ScaledClock
from sim.wire.grbl import GrblController
from sim.wire.servo import COUNT_DEG, Servo
from sim.wire.servo_bus import ServoBus

ROOM = 10.0  # degrees of travel beyond an axis's limits


class Servos:
    """rest, backlash (A,): degrees."""

    def __init__(self, config: RigConfig, rest: Array, backlash: list[float], clock: ScaledClock):
        given = config.devices.stage
        numbered = {name: k for k, name in enumerate(config.axis_names, 1)}
        bus = given if isinstance(given, ServoBusConfig) else ServoBusConfig(port="-", ids=numbered)
        self.section, self.clock = bus, clock
        self.order = [bus.ids[name] for name in config.axis_names]
        self.servos = {
            k: Servo(k, clock, 2048 + at / COUNT_DEG, backlash_deg=play)
            for k, at, play in zip(self.order, rest.tolist(), backlash)
        }
        for servo in self.servos.values():
            servo.troubles.droop = round(config.faults.droop_deg / COUNT_DEG)
        self.device = ServoBus(self.servos)

    def angles_deg(self) -> list[float]:
        return [self.servos[k].true_angle_deg() for k in self.order]

    def state(self) -> dict[str, float]:
        return {str(k): s.position(self.clock.now()) for k, s in self.servos.items()}

    def restore(self, state: dict[str, float]) -> None:
        for k, at in state.items():
            self.servos[int(k)].hold(at)


class Steppers:
    """With room beyond the limits of every axis; switched on they are at 0 and want to be homed."""

    def __init__(self, config: RigConfig, section: GrblConfig, clock: ScaledClock):
        self.section, self.wiring = section, [section.axes[n] for n in config.axis_names]
        n = 1 + max("XYZABC".index(w.letter) for w in self.wiring)
        travel, rate, ramp = [360.0] * n, [3600.0] * n, [100.0] * n
        for w, name in zip(self.wiring, config.axis_names):
            k, a = "XYZABC".index(w.letter), config.axes[name]
            travel[k] = a.upper_deg - a.lower_deg + ROOM
            rate[k], ramp[k] = 60 * a.velocity_deg_s, a.acceleration_deg_s2
        self.device = GrblController(travel, rate, ramp, clock, homing=section.homing)

    def angles_deg(self) -> list[float]:
        at = self.device.position()
        machine = [float(at["XYZABC".index(w.letter)]) for w in self.wiring]
        return [(m - w.zero_deg) * (-1 if w.reversed else 1) for m, w in zip(machine, self.wiring)]

    def state(self) -> dict[str, float]:
        return {str(k): float(x) for k, x in enumerate(self.device.position())}

    def restore(self, state: dict[str, float]) -> None:
        self.device.put(np.array(list(state.values())))


def arms_of(config: RigConfig, rest: Array, backlash: list[float], clock: ScaledClock) -> Servos | Steppers:
    """The emulated stage of a rig."""
    stage = config.devices.stage
    return Steppers(config, stage, clock) if isinstance(stage, GrblConfig) else Servos(config, rest, backlash, clock)
