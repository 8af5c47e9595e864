"""The levels that readings are measured against: the dark, and the lamp's drift by a reference point.

A dark level is shared by `plan.dark_every` measurements, told apart by their ids, so that which one a measurement gets
does not depend on the order of visits. The reference point is what the detector sees at the pose of rest.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from gonio.config.plan import PlanConfig
from gonio.geometry import Array
from gonio.rig.devices import Detector, Light
from gonio.rig.radiometry import Dark, Radiometry

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
        self.drift = 1.0
        self._darks: dict[int, Dark] = {}
        self._reference: Array | None = None
        self._since = 0

    def dark(self, number: int) -> Dark:
        """The dark level of a measurement; taken now, with the light at 0, if it is the first of its kind."""
        epoch = number // self.plan.dark_every
        if epoch not in self._darks:
            self.light.level(0)  # not off: it would have to warm up again
            self.announce(-2 - epoch)
            dark = Dark.of([self.detector.read(self.exposure) for _ in range(READINGS)])
            self._darks = {**dict(list(self._darks.items())[1 - KEPT :]), epoch: dark}
            self.light.level(1)
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
        signal = np.mean([self.radiometry.signal(r)[0] for r in readings], 0) - dark.value
        if self._reference is None:
            self._reference = signal
        self.drift = float(signal.sum() / self._reference.sum())
        self._since = 0

    def count(self) -> None:
        """One measurement more was made."""
        self._since += 1

    def state(self) -> dict[str, Any]:
        darks = {str(k): [d.value.tolist(), d.sigma.tolist(), d.exposure] for k, d in self._darks.items()}
        reference = None if self._reference is None else self._reference.tolist()
        return {"darks": darks, "reference": reference, "drift": self.drift, "since": self._since}

    def restore(self, state: dict[str, Any]) -> None:
        self._darks = {int(k): Dark(np.array(v), np.array(s), e) for k, (v, s, e) in state["darks"].items()}
        self._reference = None if state["reference"] is None else np.array(state["reference"])
        self.drift, self._since = state["drift"], state["since"]
