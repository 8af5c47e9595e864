"""Devices as the rig calls them: what their drivers let slip is a fault in one line, and what they read is a reading.

All else that a device has is the device's own.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from gonio.geometry import Array
from gonio.rig.devices import Axis, Reading
from gonio.rig.errors import DeviceFault, RigError

LONGEST = 200  # characters of somebody else's message


class Guarded:
    """The device called `name`. raw: its errors are raised as they are, as those of a simulated sample's own code."""

    def __init__(self, device: Any, name: str, raw: bool):
        self.device, self.name, self.raw = device, name, raw

    def __getattr__(self, attribute: str) -> Any:
        return getattr(self.device, attribute)

    @contextmanager
    def _asked(self, what: str) -> Iterator[None]:
        """Raises DeviceFault for whatever the device's driver raises but did not mean to."""
        try:
            yield
        except RigError:
            raise
        except Exception as e:
            if self.raw:
                raise
            said = " ".join(str(e).split())[:LONGEST]
            kind = type(self.device)
            cause = f"{type(e).__name__}{f' ({said})' if said else ''} in `{what}` of its driver"
            remedy = "check the device; an error in the driver is for whoever wrote it"
            raise DeviceFault(self.name, f"{cause} {kind.__module__}.{kind.__qualname__}", remedy) from e


class GuardedStage(Guarded):
    """Implements `gonio.rig.devices.Stage`."""

    @property
    def axes(self) -> tuple[Axis, ...]:
        axes: tuple[Axis, ...] = self.device.axes
        return axes

    @property
    def homed(self) -> bool:
        with self._asked("homed"):
            return bool(self.device.homed)

    def move(self, pose: Array, deadline: float) -> Array:
        with self._asked("move"):
            at: Array = self.device.move(pose, deadline)
            return at

    def pose(self) -> Array:
        with self._asked("pose"):
            at: Array = self.device.pose()
            return at

    def home(self) -> None:
        with self._asked("home"):
            self.device.home()

    def stop(self) -> None:
        with self._asked("stop"):
            self.device.stop()

    def allow(self) -> None:
        with self._asked("allow"):
            self.device.allow()

    def park(self) -> None:
        with self._asked("park"):
            self.device.park()


class GuardedLight(Guarded):
    """Implements `gonio.rig.devices.Light`."""

    def on(self) -> None:
        with self._asked("on"):
            self.device.on()

    def off(self) -> None:
        with self._asked("off"):
            self.device.off()

    def level(self, fraction: float) -> None:
        with self._asked("level"):
            self.device.level(fraction)


class GuardedDetector(Guarded):
    """Implements `gonio.rig.devices.Detector`. blind: it may see nothing at all, which it says as NaN."""

    def __init__(self, device: Any, name: str, raw: bool, channels: int, blind: bool):
        super().__init__(device, name, raw)
        self.wanted, self.blind = channels, blind

    def expect(self, signal: Array | None) -> None:
        with self._asked("expect"):
            self.device.expect(signal)

    def read(self, exposure: float | None = None) -> Reading:
        with self._asked("read"):
            reading: Reading = self.device.read(exposure)
        if (wrong := self._wrong(reading)) is not None:
            kind = type(self.device)
            driver = f"{kind.__module__}.{kind.__qualname__}"
            raise DeviceFault(self.name, f"gave no reading: {wrong}", f"check the device and its driver {driver}")
        return reading

    def _wrong(self, r: Any) -> str | None:
        """What makes it no reading of this rig's channels."""
        if not isinstance(r, Reading):
            return f"{type(r).__name__} in place of a Reading"
        for name, a in (("value", r.value), ("sigma", r.sigma)):
            if not isinstance(a, np.ndarray) or a.dtype.kind not in "fiu":
                return f"its {name} is no array of numbers"
            if a.shape != (self.wanted,):
                return f"its {name} has the shape {a.shape} in place of ({self.wanted},)"
        if (r.sigma < 0).any():
            return f"a sigma of {r.sigma.min():g}"
        if not isinstance(r.raw, Mapping) or not r.raw.get("exposure_s"):
            return "without raw['exposure_s']"
        if r.saturated:
            return None
        nothing = np.isnan(r.value) & self.blind
        if not (np.isfinite(r.value) | nothing).all():
            return "a value that is not finite, and not saturated"
        if not (np.isfinite(r.sigma) | nothing).all():
            return "a sigma that is not finite"
        return None
