"""A simulated stage: trapezoidal motion on a virtual clock, encoder counts, backlash, servos that stop short or stick.

The encoder sits on the motor. Behind it the arm lags by the backlash while it is driven downwards; driven upwards it is
where the encoder says.
"""

import numpy as np

from gonio.config.rig import FaultsConfig
from gonio.geometry import Array
from gonio.rig.clock import Clock
from gonio.rig.devices import Axis
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.rig.motion.profile import move_time, progress
from sim.noise import STAGE, generator


class SimStage:
    """Implements `gonio.rig.devices.Stage`; `true_pose` is where the arms really are."""

    def __init__(
        self, axes: tuple[Axis, ...], backlash: Array, park: Array, faults: FaultsConfig, clock: Clock, seed: int
    ):
        self._axes, self.backlash, self._park, self.faults, self.clock, self.seed = (
            axes,
            backlash,
            park,
            faults,
            clock,
            seed,
        )
        self.velocity = np.array([a.velocity for a in axes])
        self.acceleration = np.array([a.acceleration for a in axes])
        self._encoder = park.copy()
        self._lag = np.zeros(len(axes))
        self._stopped = False
        self.homed = False
        self.announce(-1)

    @property
    def axes(self) -> tuple[Axis, ...]:
        return self._axes

    def home(self) -> None:
        self.homed = True

    def announce(self, number: int) -> None:
        """The measurement that the next moves are for; what goes wrong in them follows from it."""
        self._number = number
        self._rng: np.random.Generator | None = None

    def move(self, pose: Array, deadline: float) -> Array:
        """Go there; the pose that the encoders show afterwards. Raises DeviceFault for a joint stuck or out of time."""
        pose = np.asarray(pose, float)
        for k, a in enumerate(self._axes):
            if not a.lower - 1e-9 <= pose[k] <= a.upper + 1e-9:
                raise SafetyStop(
                    f"{a.name}: {np.degrees(pose[k]):.3f} degrees lies outside its limits; not driven there"
                )
        if self._stopped:
            return self._encoder.copy()
        delta = pose - self._encoder
        seconds = float(move_time(delta, self.velocity, self.acceleration))
        if self.faults.stuck_axis or self.faults.droop_deg:
            delta = self._faulty(delta)
        share = min(1.0, progress(delta, self.velocity, self.acceleration, deadline)) if seconds > deadline else 1.0
        self.clock.sleep(min(seconds, deadline))
        self._go(delta * share)
        if share < 1:
            raise DeviceFault(
                self._axes[int(np.abs(delta).argmax())].name, f"not there after {deadline:.1f} s", "is it blocked?"
            )
        off = np.abs(pose - self._encoder)
        if off.max() > np.radians(5) + 1e-9:
            name = self._axes[int(off.argmax())].name
            raise DeviceFault(name, f"stopped {np.degrees(off.max()):.1f} degrees short", "free the joint, then home")
        return self._encoder.copy()

    def pose(self) -> Array:
        return self._encoder.copy()

    def true_pose(self) -> Array:
        """Where the arms really are (A,)."""
        return self._encoder + self._lag

    def stop(self) -> None:
        self._stopped = True

    def allow(self) -> None:
        self._stopped = False

    def park(self) -> None:
        self.move(self._park, 3600.0)

    def state(self) -> dict[str, list[float]]:
        return {"encoder": self._encoder.tolist(), "lag": self._lag.tolist()}

    def restore(self, state: dict[str, list[float]]) -> None:
        self._encoder, self._lag = np.array(state["encoder"]), np.array(state["lag"])

    def _go(self, delta: Array) -> None:
        step = np.array([a.resolution for a in self._axes])
        target = self._encoder + delta
        self._encoder = np.where(step > 0, np.round(target / np.where(step > 0, step, 1)) * step, target)
        if self.backlash.any():
            self._lag = np.where(delta > 1e-9, 0.0, np.where(delta < -1e-9, self.backlash, self._lag))

    def _faulty(self, delta: Array) -> Array:
        if self._rng is None:
            self._rng = generator(self.seed, STAGE, self._number)
        short = self._rng.random(len(delta)) * np.radians(self.faults.droop_deg)
        delta = np.sign(delta) * np.maximum(np.abs(delta) - short, 0)
        if self._rng.random() < self.faults.stuck_axis:
            delta[self._rng.integers(len(delta))] = 0
        return delta
