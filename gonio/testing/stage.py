"""Is it a stage: moves inside its limits and says where it is, stops from any thread, keeps deadlines?"""

import threading
from functools import partial
from typing import Any

import numpy as np

from gonio.geometry import Array
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.testing.common import (
    PATIENCE_S,
    Do,
    Make,
    check_class,
    check_closing,
    check_doctor,
    check_fault,
    expect_fault,
    in_thread,
    require,
)

NEAR = np.radians(0.5)  # a pose that counts as reached
STEP = 0.1  # of each axis's span that the first move goes


def check_stage(make: Make, *, fault: Do | None = None, mend: Do | None = None) -> None:
    """Its arms may go wherever its limits let them: nothing may stand in their way. Raises Nonconformity."""
    device = make()
    check_class(device)
    try:
        device.connect()
        low, high = _axes(device)
        device.home()
        require(device.homed is True, "home: homed is not True afterwards")
        start = _pose(device, low, high)
        _moves(device, low, high, start)
        _limits(device, low, high)
        _stop(device, low, high)
        _deadline(device, low, high)
        device.park()
        rest = _pose(device, low, high)
    finally:
        device.close()
    check_closing(make)
    again = make()
    try:
        again.connect()
        again.home()  # which may move it
        again.park()
        at = _pose(again, low, high)
        require(np.abs(at - rest).max() < NEAR, f"opened again: at {at}, before {rest}")
    finally:
        again.close()
    check_doctor(make)
    check_fault(make, lambda d: d.move(0.5 * (low + high), 60.0), fault, mend)


def _axes(device: Any) -> tuple[Array, Array]:
    axes = device.axes
    require(axes and len({a.name for a in axes}) == len(axes), "axes: none, or two of one name")
    for a in axes:
        require(a.lower < a.upper and a.velocity > 0 and a.acceleration > 0, f"axes: {a} cannot move")
    return np.array([a.lower for a in axes]), np.array([a.upper for a in axes])


def _pose(device: Any, low: Array, high: Array) -> Array:
    at = device.pose()
    require(isinstance(at, np.ndarray) and at.shape == low.shape and np.isfinite(at).all(), f"pose: {at!r}")
    inside = (at > low - NEAR).all() and (at < high + NEAR).all()
    require(inside, f"pose: {at} lies outside its limits")
    return at


def _moves(device: Any, low: Array, high: Array, start: Array) -> None:
    """There and back, as it says itself."""
    middle = 0.5 * (low + high)
    for goal in (start + STEP * (middle - start), middle, middle + STEP * (high - middle)):
        at = in_thread(partial(device.move, goal, 120.0), "move")
        require(np.abs(at - goal).max() < NEAR, f"move: to {goal}, says it is at {at}")
        require(np.abs(_pose(device, low, high) - at).max() < NEAR, "pose: is not what move gave back")


def _limits(device: Any, low: Array, high: Array) -> None:
    """What lies outside is refused before anything moves."""
    before = _pose(device, low, high)
    for k in range(len(low)):
        for wrong in (high[k] + np.radians(5), low[k] - np.radians(5), np.nan, np.inf):
            goal = before.copy()
            goal[k] = wrong
            try:
                device.move(goal, 60.0)
            except (SafetyStop, DeviceFault):
                continue
            require(False, f"move: {device.axes[k].name} to {wrong:.4g}, outside its limits, is not refused")
    require(np.abs(_pose(device, low, high) - before).max() < NEAR, "move: a pose that was refused moved it")


def _stop(device: Any, low: Array, high: Array) -> None:
    """A move under way ends, none begins until `allow`. The stop may come before, in or after the move."""
    middle = 0.5 * (low + high)
    began, result = threading.Event(), {}

    def go() -> None:
        began.set()
        try:
            result["at"] = device.move(middle + 0.8 * (low - middle), 600.0)
        except BaseException as e:
            result["error"] = e

    thread = threading.Thread(target=go, daemon=True)
    thread.start()
    began.wait(PATIENCE_S)
    in_thread(device.stop, "stop")
    thread.join(PATIENCE_S)
    require(not thread.is_alive(), f"stop: the move under way does not end within {PATIENCE_S:g} s")
    require("error" not in result, f"stop: the move under way raises {result.get('error')!r}")
    here = _pose(device, low, high)
    require(np.isfinite(result["at"]).all(), "stop: the move under way does not say where it is")
    at = in_thread(lambda: device.move(middle + 0.8 * (high - middle), 60.0), "move after stop")
    require(np.abs(at - here).max() < 4 * NEAR, "stop: a move was obeyed before `allow`")
    device.allow()
    at = in_thread(lambda: device.move(middle, 120.0), "move after allow")
    require(np.abs(at - middle).max() < NEAR, "allow: a move is not obeyed afterwards")


def _deadline(device: Any, low: Array, high: Array) -> None:
    """A move that cannot be there in time is a DeviceFault, and the stage can be used again."""
    middle = 0.5 * (low + high)
    expect_fault(lambda: device.move(middle + 0.8 * (low - middle), 1e-4), "a move that misses its deadline")
    device.allow()
    at = in_thread(lambda: device.move(middle, 120.0), "move after a missed deadline")
    require(np.abs(at - middle).max() < NEAR, "a missed deadline: the next move does not arrive")
