"""What a device must offer. `drivers` (real) and `sim` (simulated) are two families of these, peers of each other."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array
from gonio.rig.on_way import Way


@dataclass(frozen=True)
class Axis:
    """One joint: limits in rad, top speed in rad/s, acceleration in rad/s^2, resolution in rad (0 = continuous)."""

    name: str
    lower: float
    upper: float
    velocity: float
    acceleration: float
    resolution: float = 0.0


@dataclass(frozen=True)
class Reading:
    """One reading: per channel signal and its sigma (C,), over the whole exposure, dark NOT subtracted.

    raw is what the device itself said, JSON; `exposure_s` (seconds) is always there, `full_scale` (C,) of the ranges
    used where the device has ranges.
    """

    value: Array
    sigma: Array
    saturated: bool
    raw: dict[str, Any]


class Stage(Protocol):
    """Axes that start and stop together: a move is a straight line in joint space. Poses are (A,) radians."""

    @property
    def axes(self) -> tuple[Axis, ...]: ...

    def move(self, pose: Array, deadline: float) -> Array:
        """Go there and come to rest; the pose achieved. Raises DeviceFault, SafetyStop; late = `deadline` seconds."""
        ...

    def pose(self) -> Array:
        """What the encoders say."""
        ...

    @property
    def homed(self) -> bool:
        """Whether `pose` can be believed; nothing may move on a plan before."""
        ...

    def home(self) -> None:
        """Find or confirm the zero of every axis. Raises DeviceFault."""
        ...

    def stop(self) -> None:
        """Halt all axes where they are, at once; from any thread. Every `move` returns at once until `allow`."""
        ...

    def allow(self) -> None:
        """Moves are obeyed again after a stop."""
        ...

    def park(self) -> None: ...


class Detector(Protocol):
    """Reads (C,) signals in a unit of its own, which `gonio.rig.signal.radiometry` turns into f."""

    def expect(self, signal: Array | None) -> None:
        """About what the next reading will be, None = unknown: saves trials of ranges or exposures. May be ignored."""
        ...

    def read(self, exposure: float | None = None) -> Reading:
        """One reading; exposure in seconds, None = the detector's own choice."""
        ...


class Light(Protocol):
    def on(self) -> None: ...

    def off(self) -> None: ...

    def level(self, fraction: float) -> None: ...


@dataclass(frozen=True)
class Visited:
    """Measurements just made, M of them, in the order they were made.

    ids        (M,) which of those asked for
    wi, wo     (M, 3) directions as achieved
    f, sigma   (M, C) BRDF in 1/sr (no cosine) and its standard deviation; NaN = could not be measured
    saturated  (M,)
    raw        one record per measurement of what the detector itself said, to be stored beside f; may be empty
    rig_s      (M,) rig seconds each took (motion + settle + exposure)
    """

    ids: NDArray[np.int64]
    wi: Array
    wo: Array
    f: Array
    sigma: Array
    saturated: NDArray[np.bool_]
    raw: tuple[dict[str, Any], ...]
    rig_s: Array


class Rig(Protocol):
    """A gonioreflectometer: all that the acquisition loop knows of one.

    surrogate(wi, wo) -> f (N, C), or None where it knows nothing yet, is what readings will be about; the loop sets it,
    a rig may ignore it. on_way(way), None = nobody wants it, is called with what was read on each leg of a move,
    before `visit` gives the measurement that the move leads to; the loop sets it, a rig that cannot ignores it.
    """

    surrogate: Callable[[Array, Array], Array | None] | None
    on_way: Callable[[Way], None] | None

    @property
    def simulated(self) -> bool: ...

    @property
    def channels(self) -> int: ...

    @property
    def calibration_ids(self) -> Mapping[str, str]:
        """Calibrations in use, kind -> id: part of a run's provenance."""
        ...

    def reachable(self, wi: Array, wo: Array) -> NDArray[np.bool_]:
        """Which pairs the rig can visit, decided before sampling; the support of the target. Touches no hardware."""
        ...

    def visit(self, wi: Array, wo: Array, ids: NDArray[np.int64]) -> Iterator[Visited]:
        """Measure every pair, in the order the rig finds cheapest: an iterator of `Visited`.

        ids (M,) number the measurements of a run. A simulated rig draws the noise of a measurement from its id, so
        that a resumed run, which may visit in another order, sees the very readings an uninterrupted one would.
        What one `Visited` holds is to be stored before the next is asked for: the next motion starts then.
        """
        ...

    def look(self) -> None:
        """Whether it still sees what it should: confirms what was measured lately. Raises LostSight."""
        ...

    def state(self) -> dict[str, Any]:
        """What a resumed run needs to go on exactly (simulated rigs: pose, noise generator, clock); JSON."""
        ...

    def restore(self, state: dict[str, Any]) -> None: ...

    def stop(self) -> None:
        """Halt at once. May be called from another thread."""
        ...

    def close(self) -> None:
        """Light off, motors as the config says, devices let go."""
        ...
