"""The levels that readings are measured against: the dark, and the lamp's drift by a reference point.

A dark level is shared by `plan.dark_every` measurements, told apart by their ids, so that which one a measurement gets
does not depend on the order of visits. The reference point is what the detector sees at the pose of rest.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.config.plan import PlanConfig
from gonio.rig.devices import Detector, Light
from gonio.rig.errors import DeviceFault
from gonio.rig.signal.radiometry import Dark, Radiometry

READINGS = 16  # that make one level
KEPT = 4  # dark levels


class Levels:
    """Takes the levels of one rig when they are due. announce(id) tells simulated devices whose noise to draw."""

    def __init__(
        self,
        detector: Detector,
        light: Light,
        radiometry: Radiometry,
        exposure: float,
        plan: PlanConfig,
        announce: Callable[[int], None],
    ):
        self.detector, self.light, self.radiometry = detector, light, radiometry
        self.exposure, self.plan, self.announce = exposure, plan, announce
        self.drift, self.drift_sigma = 1.0, 0.0
        self._darks: dict[int, Dark] = {}
        self._reference: tuple[float, float] | None = None  # signal of all channels, and its relative sigma
        self._since = 0

    def dark(self, number: int) -> Dark:
        """The dark level of a measurement; taken now, with the light at 0, if it is the first of its kind."""
        epoch = number // self.plan.dark_every
        if epoch not in self._darks:
            self.light.level(0)  # not off: it would have to warm up again
            self.announce(-2 - epoch)
            dark = Dark.of([self.detector.read(self.exposure) for _ in range(READINGS)])
            self.light.level(1)
            if not np.isfinite(dark.value).all():
                return dark  # a camera sees nothing from here: the next measurement tries again
            self._darks = {**dict(list(self._darks.items())[1 - KEPT :]), epoch: dark}
        return self._darks[epoch]

    @property
    def reference_is_due(self) -> bool:
        """Whether the reference point is to be looked at before the next measurement."""
        every = self.plan.reference_every
        return every > 0 and (self._reference is None or self._since >= every)

    def look_at_reference(self, number: int) -> None:
        """The drift, from readings at the pose of rest, where the rig stands."""
        dark = self.dark(number)
        self.announce(-(1 << 40) - number)
        readings = [self.detector.read(self.exposure) for _ in range(READINGS)]
        values, sigmas = zip(*(self.radiometry.signal(r) for r in readings))
        signal = float(np.sum(np.mean(values, 0) - dark.value))
        noise = float(np.sqrt(np.sum(np.square(sigmas)) / READINGS**2 + np.sum(dark.sigma**2)))
        if not signal > 5 * noise:
            raise DeviceFault(
                "detector", "the reference point is as good as dark", "choose another park_deg, or check the light"
            )
        if self._reference is None:
            self._reference = signal, noise / signal
            self.drift, self.drift_sigma = 1.0, 0.0
        else:
            first, uncertain = self._reference
            self.drift = signal / first
            self.drift_sigma = self.drift * float(np.hypot(noise / signal, uncertain))
        self._since = 0

    def count(self) -> None:
        """One measurement more was made."""
        self._since += 1

    def state(self) -> dict[str, Any]:
        darks = {str(k): [d.value.tolist(), d.sigma.tolist(), d.exposure] for k, d in self._darks.items()}
        drift = {"drift": self.drift, "drift_sigma": self.drift_sigma}
        return {"darks": darks, "reference_point": self._reference, **drift, "since": self._since}

    def restore(self, state: dict[str, Any]) -> None:
        self._darks = {int(k): Dark(np.array(v), np.array(s), e) for k, (v, s, e) in state["darks"].items()}
        point = state.get("reference_point")  # of a run that began before there was one, none
        self._reference = None if point is None else (point[0], point[1])
        self.drift, self.drift_sigma = state["drift"], state.get("drift_sigma", 0.0)
        self._since = state["since"]
