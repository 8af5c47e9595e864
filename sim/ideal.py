"""The ideal rig: f exactly where it was asked for, and the time that the motion would take.

Equivalent poses, a turned table, swapped arms are used to save motion, and are taken at their word: the reading is
`truth` at the pair asked for. Nothing depends on the order of visits, so a resumed run is the same run.
"""

from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import envelope_of, park_pose
from gonio.rig.clock import VirtualClock
from gonio.rig.devices import Visited
from gonio.rig.motion.plan import Planner
from gonio.rig.on_way import Way
from sim.sample import Sample


class IdealRig:
    """Implements `gonio.rig.devices.Rig`. Seconds pass on `clock` only."""

    simulated = True
    calibration_ids: Mapping[str, str] = MappingProxyType({})
    surrogate: Callable[[Array, Array], Array | None] | None = None  # a reading costs no trials here
    on_way: Callable[[Way], None] | None = None  # nothing is read while it moves

    def __init__(self, config: RigConfig, sample: Sample, plan: PlanConfig, isotropic: bool):
        self.config, self.sample = config, sample
        self.envelope = envelope_of(config)
        self.planner = Planner(self.envelope, plan, isotropic)
        self.clock = VirtualClock()
        self._pose = park_pose(config)
        self._stopped = False

    @property
    def channels(self) -> int:
        return self.sample.channels

    def reachable(self, wi: Array, wo: Array) -> NDArray[np.bool_]:
        return self.envelope.reachable(wi, wo)

    def visit(self, wi: Array, wo: Array, ids: NDArray[np.int64]) -> Iterator[Visited]:
        """Tours (`plan.window` measurements at most) in the planned order; pairs out of reach come last, as NaN."""
        self._stopped = False
        wi, wo, ids = np.asarray(wi, float), np.asarray(wo, float), np.asarray(ids)
        still = self.config.settle_s + self.config.exposure_s
        left = len(wi)
        for tour in self.planner.tours(wi, wo, self._pose):
            if self._stopped:
                return
            seconds = tour.seconds + still
            self._pose = tour.poses[-1]
            self.clock.sleep(float(seconds.sum()))
            left -= len(tour.which)
            yield self._visited(ids, wi, wo, tour.which, seconds)
        if left and not self._stopped:
            seen = self.reachable(wi, wo)
            yield self._visited(ids, wi, wo, np.flatnonzero(~seen), np.zeros(int((~seen).sum())))

    def _visited(self, ids, wi: Array, wo: Array, which, seconds: Array) -> Visited:
        n = len(which)
        wi, wo = wi[which], wo[which]
        f = self.sample.eval(wi, wo) if seconds.any() else np.full((n, self.channels), np.nan)
        return Visited(ids[which], wi, wo, f, np.zeros_like(f), np.zeros(n, bool), (), seconds)

    def look(self) -> None:
        """It always sees."""

    def state(self) -> dict[str, Any]:
        return {"pose": self._pose.tolist(), "clock_s": self.clock.now()}

    def restore(self, state: dict[str, Any]) -> None:
        self._pose = np.array(state["pose"], float)
        self.clock = VirtualClock(state["clock_s"])

    def stop(self) -> None:
        self._stopped = True

    def close(self) -> None:
        self._stopped = True
