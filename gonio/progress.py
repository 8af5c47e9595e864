"""How far a run is: what the loop counts and a watcher is shown."""

import time
from dataclasses import dataclass, field


@dataclass
class Progress:
    """What a watcher is shown while a run goes on."""

    measured: int = 0
    free: int = 0
    steps: int = 0
    accepted: int = 0
    rig_s: float = 0.0
    began: float = field(default_factory=time.monotonic)
    measured_before: int = 0
    budget: int | None = None
    energy_error: float | None = None

    @property
    def acceptance(self) -> float:
        return self.accepted / self.steps if self.steps else 0.0

    def eta_s(self) -> float | None:
        """Seconds left to the measurement budget at the pace of this session; None where there is no telling."""
        done = self.measured - self.measured_before
        if self.budget is None or done == 0:
            return None
        return (self.budget - self.measured) * (time.monotonic() - self.began) / done
