"""A rig to put a driver in, for tests."""

from typing import Any

from gonio.config.rig import AxisConfig, RigConfig
from gonio.rig.clock import Clock, RealClock
from gonio.rig.driver import Setting

AXES = {
    "light": AxisConfig(lower_deg=-85, upper_deg=85),
    "turntable": AxisConfig(lower_deg=-180, upper_deg=179.95),
    "detector": AxisConfig(lower_deg=-85, upper_deg=85),
    "azimuth": AxisConfig(lower_deg=-180, upper_deg=179.95),
}


def setting(clock: Clock | None = None, **rig: Any) -> Setting:
    """A gantry of four axes; `rig`: keys of its YAML that are to be otherwise."""
    config = RigConfig.model_validate({"name": "test", "depth": "wire", "axes": AXES, **rig})
    return Setting(config, clock or RealClock(), patient=False)
