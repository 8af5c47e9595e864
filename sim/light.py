"""A simulated lamp: on, off, level, and a slow drift."""

from gonio.config.rig import LightConfig
from gonio.rig.clock import Clock


class SimLight:
    def __init__(self, config: LightConfig, clock: Clock):
        self.config, self.clock = config, clock
        self.lit = False
        self._fraction = 1.0

    def on(self) -> None:
        """Lit when this returns, `warm_up_s` later if it was dark."""
        if not self.lit:
            self.lit = True
            self.clock.sleep(self.config.warm_up_s)

    def off(self) -> None:
        self.lit = False

    def level(self, fraction: float) -> None:
        if not 0 <= fraction <= 1:
            raise ValueError(f"level must lie in [0, 1], not {fraction}")
        self._fraction = fraction

    def power(self) -> float:
        """Now, relative to the lamp's full level at the origin of the clock."""
        return self.lit * self._fraction * (1 + self.config.drift_per_h * self.clock.now() / 3600)
