"""What a driver has to be: the class that an entry point of `gonio.stages`, `gonio.detectors` or `gonio.lights` names.

It is made with its section of the rig's YAML (an instance of its own `Config`) and the rig that it is in, does nothing
until `connect`, and lets everything go in `close`, which never raises. Besides, it is a `Stage`, `Detector` or `Light`
of `gonio.rig.devices`. `gonio.testing` checks all of it.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, Protocol

import numpy as np

from gonio.config.plugins import DeviceSection
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import envelope_of, park_pose
from gonio.rig.clock import Clock
from gonio.rig.devices import Axis
from gonio.rig.motion.envelope import Envelope


@dataclass(frozen=True)
class Setting:
    """The rig that a driver is in. patient: a port that is away is waited for; the doctor does not."""

    rig: RigConfig
    clock: Clock
    patient: bool = True

    @cached_property
    def envelope(self) -> Envelope:
        return envelope_of(self.rig)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Limits, speeds and accelerations, in the order of a pose; rad."""
        return self.envelope.axes

    @property
    def park(self) -> Array:
        """The pose of rest (A,), rad."""
        return self.envelope.snap(np.asarray(park_pose(self.rig)))


class Driver(Protocol):
    Config: ClassVar[type[DeviceSection]]

    def __init__(self, config: Any, setting: Setting): ...

    def connect(self) -> None:
        """Open its port and confirm that it is what it should be; nothing moves, a lamp is off. Raises DeviceFault."""
        ...

    def close(self) -> None: ...

    def doctor(self) -> Iterator[str]:
        """Lines that begin with `ok`, `warn` or `FAIL`, of a device not connected yet; moves nothing. May raise
        DeviceFault, which is said as a `FAIL`. `close` is called afterwards."""
        ...
