"""Is it a detector: readings of one shape with sigma and exposure, alike from any thread, refused in one line?"""

import json
from typing import Any

import numpy as np

from gonio.rig.devices import Reading
from gonio.testing.common import Do, Make, check_class, check_closing, check_doctor, check_fault, in_thread, require

SURE = 12.0  # sigmas


def check_detector(
    make: Make, *, exposure: float | None = 0.1, fault: Do | None = None, mend: Do | None = None
) -> None:
    """A steady light lies on it. exposure: a time that it can be read for. Raises Nonconformity."""
    device = make()
    check_class(device)
    try:
        device.connect()
        channels = device.channels
        require(isinstance(channels, int) and channels >= 1, f"channels: {channels!r} after connect")
        first = _reading(device, None, channels)
        if exposure is not None:
            seconds = _reading(device, exposure, channels).raw["exposure_s"]
            near = 0.5 * exposure <= seconds <= 2 * exposure
            require(near, f"read({exposure:g}): raw['exposure_s'] is {seconds:g}")
        for what, signal in (
            ("None", None),
            ("what it read", first.value),
            ("0", np.zeros(channels)),
            ("1e6 of it", 1e6 * (np.abs(first.value) + 1)),
            ("NaN", np.full(channels, np.nan)),
        ):
            device.expect(signal)
            _alike(first, _reading(device, None, channels), f"after expect({what})")
        _alike(first, in_thread(lambda: _reading(device, None, channels), "read"), "from another thread")
    finally:
        device.close()
    check_closing(make)
    again = make()
    try:
        again.connect()
        require(again.channels == channels, f"opened again: {again.channels} channels in place of {channels}")
        _alike(first, _reading(again, None, channels), "opened again")
    finally:
        again.close()
    check_doctor(make)
    check_fault(make, lambda d: d.read(), fault, mend)


def _reading(device: Any, exposure: float | None, channels: int) -> Reading:
    r = device.read(exposure)
    require(isinstance(r, Reading), f"read: {type(r).__name__} in place of a Reading")
    for name in ("value", "sigma"):
        a = getattr(r, name)
        good = isinstance(a, np.ndarray) and a.shape == (channels,) and a.dtype == np.float64
        require(good, f"read: {name} is no float64 array of shape ({channels},)")
    require(r.saturated in (True, False), f"read: saturated is {r.saturated!r}")
    if not r.saturated:
        require(np.isfinite(r.value).all(), "read: value is not finite, and not saturated")
        require(np.isfinite(r.sigma).all() and (r.sigma >= 0).all(), "read: sigma is not finite and at least 0")
    seconds = r.raw.get("exposure_s")
    require(isinstance(seconds, float | int) and seconds > 0, "read: raw['exposure_s'] is missing or not above 0")
    for name in ("range", "full_scale"):
        if name in r.raw:
            require(len(r.raw[name]) == channels, f"read: raw[{name!r}] is not one a channel")
    try:
        json.dumps(r.raw, allow_nan=False)
    except (TypeError, ValueError) as e:
        require(False, f"read: raw is not JSON ({e})")
    return r


def _alike(a: Reading, b: Reading, when: str) -> None:
    """The same light, by its own sigma."""
    off = np.abs(a.value - b.value)
    within = off <= SURE * np.hypot(a.sigma, b.sigma) + 1e-9 * np.abs(a.value)
    require(a.saturated == b.saturated and (a.saturated or within.all()), f"read {when}: {b.value}, before {a.value}")
