"""The rig as a run sees it: what is measured also goes on the board, and a stop ends the run, not just a move."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from gonio.acquire import Interrupted
from gonio.daemon.health import pose_deg
from gonio.daemon.status_board import StatusBoard
from gonio.geometry import Array
from gonio.rig.devices import Rig, Visited


class RigView:
    """Implements the part of `gonio.rig.devices.Rig` that a run uses; closing stays with the owner."""

    def __init__(self, rig: Rig, board: StatusBoard, stopped: Callable[[], bool]):
        self._rig, self._board, self._stopped = rig, board, stopped
        self.simulated, self.channels, self.calibration_ids = rig.simulated, rig.channels, rig.calibration_ids
        self.reachable, self.state, self.restore, self.stop = rig.reachable, rig.state, rig.restore, rig.stop
        self.look = rig.look

    @property
    def surrogate(self):
        return self._rig.surrogate

    @surrogate.setter
    def surrogate(self, predict) -> None:
        self._rig.surrogate = predict

    def visit(self, wi: Array, wo: Array, ids: NDArray[np.int64]) -> Iterator[Visited]:
        """As the rig's own. Raises Interrupted where it was stopped: a stopped rig ends a visit early, and a run that
        asked again would set it moving again."""
        if self._stopped():
            raise Interrupted
        for seen in self._rig.visit(wi, wo, ids):
            self._board.add(seen.wi, seen.wo, seen.f, seen.saturated)
            self._board.write(pose_deg=pose_deg(self._rig, seen))
            yield seen
            if self._stopped():
                break
        if self._stopped():
            raise Interrupted

    def close(self) -> None:
        """Nothing: the daemon keeps the rig."""
