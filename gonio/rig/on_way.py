"""What is read while the arms move: a detector's stream, a stage's track, and the BRDF values of one way.

    stream (detector, by its clock) + track (stage, by the rig's) -> directions and f of every window -> Way

A detector or stage that cannot do so is still a detector or stage: whoever wants a stream asks
`isinstance(device, Streaming)`, or `Tracking`, first.
"""

from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from gonio.geometry import Array


@dataclass(frozen=True)
class Stream:
    """K windows that a detector read one after another, the first and last included; K may be 0.

    seconds      (K,) the middle of each, on the rig's clock (the detector's counter, carried over)
    window_s     how long each was exposed
    value, sigma (K, C) signal over one window and its standard deviation, dark NOT subtracted, as `Reading` has them
    saturated    (K,)
    lost         windows that never arrived, or arrived damaged
    raw          what holds for all of them: `exposure_s` = window_s, `full_scale` and `range` (C,) where it has ranges
    """

    seconds: Array
    window_s: float
    value: Array
    sigma: Array
    saturated: NDArray[np.bool_]
    lost: int
    raw: dict[str, Any]


@runtime_checkable
class Streaming(Protocol):
    """A detector that reads on without being asked each time."""

    @property
    def rates(self) -> tuple[float, float]:
        """The least and most readings a second."""
        ...

    def stream(self, rate: float, largest: Array | None) -> None:
        """Begin at once, `rate` a second, ranges held such that the signal `largest` (C,) fits, in the units of a
        reading of the nominal exposure without dark; None = not known: the highest. Raises DeviceFault."""
        ...

    def end_stream(self) -> Stream:
        """Stop, and what was read since `stream`; the next `read` is as if there had been none. Raises DeviceFault."""
        ...


@dataclass(frozen=True)
class Track:
    """Where the encoders were during the last move: seconds (P,) on the rig's clock, pose (P, A) rad.

    The first and the last row are the poses of rest before and after it; the times of these two are when the move was
    asked for and when it was seen to have ended, which the motion itself lies between.
    """

    seconds: Array
    pose: Array


@runtime_checkable
class Tracking(Protocol):
    """A stage that keeps where it was while it moved."""

    def track(self) -> Track:
        """Of the last `move`, which has ended."""
        ...


@dataclass(frozen=True)
class Way:
    """K readings made on one leg of a move, in the order they were made.

    number   the id of the measurement that the move leads to
    leg      0, 1, … of the legs of that move
    seconds  (K,) of rig time since the leg began
    wi, wo   (K, 3) directions in the middle of each window
    f, sigma (K, C) 1/sr, no cosine; sigma is the detector's noise alone
    along    (K,) rad: standard deviation of where on its path a reading was made, sqrt(|dwi|^2 + |dwo|^2), the part
             that is its own: blur of the window, jitter of the clocks
    shared   (K,) rad: the part that all readings of the move have in common: offset of the clocks, fit of the motion
    """

    number: int
    leg: int
    seconds: Array
    wi: Array
    wo: Array
    f: Array
    sigma: Array
    along: Array
    shared: Array

    def __len__(self) -> int:
        return len(self.seconds)
