"""The rig that the daemon, or one command, holds: opened when a job first needs it, let go after a fault or at the end.

A simulated rig shows what lies on it, so that every run opens one of its own; a real one stays open from job to job,
unless the job plans its motion otherwise.
"""

from typing import Any

from gonio.brdf import Brdf
from gonio.config import Material
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.rig.devices import Rig
from gonio.run.open_rig import open_rig


class RigOwner:
    """One rig config and, while open, its rig. For the thread that owns the rig, but for `stop`."""

    def __init__(self, config: RigConfig):
        self.config = config
        self.rig: Any = None
        self._opened_for: tuple[PlanConfig, bool] | None = None

    def for_run(self, material: Material, truth: Brdf | None) -> Rig:
        """The rig with the material on it. A real rig that was homed is homed again if it has to be opened anew."""
        isotropic = material.symmetry == "isotropic"
        if self.rig is not None and self.config.depth == "real" and self._opened_for == (material.plan, isotropic):
            return self.rig
        homed = self.rig is not None and self.config.depth == "real" and self.rig.stage.homed
        self.close()
        self.rig = open_rig(self.config, truth, material.seed, plan=material.plan, isotropic=isotropic)
        self._opened_for = material.plan, isotropic
        if homed:
            self.rig.home()
        return self.rig

    def as_is(self, truth: Brdf | None = None, *, calibrated: bool = True) -> Any:
        """The rig as it stands; one just opened, if simulated, shows `truth`, or a white diffuser.

        calibrated: it is to measure f, and a real rig needs its radiometry for that; moving does not.
        """
        if self.rig is not None and calibrated and self._opened_for is None:
            self.close()
        if self.rig is None or (truth is not None and self.config.depth != "real"):
            self.close()
            if not calibrated and self.config.depth == "real":
                from drivers.rig import open_real

                self.rig = open_real(self.config, PlanConfig(), False, calibrated=False)
                self._opened_for = None
                return self.rig
            if self.config.depth != "real" and truth is None:
                from gonio.brdf.models.lambert import Lambert

                truth = Lambert([1.0] * (self.config.channels or 3))
            config = self.config
            if not calibrated:  # what is about to be made anew may be as old as it likes
                files = config.calibration.model_copy(update={"allow_stale": True})
                config = config.model_copy(update={"calibration": files})
            self.rig = open_rig(config, truth, 0)
            self._opened_for = PlanConfig(), False
        return self.rig

    def stop(self) -> None:
        """Halt at once; from any thread."""
        if (rig := self.rig) is not None:
            rig.stop()

    def dark(self) -> None:
        """Light off: no job is under way."""
        if (light := getattr(self.rig, "light", None)) is not None:
            light.off()

    def close(self) -> None:
        rig, self.rig = self.rig, None
        if rig is not None:
            rig.close()

    def __enter__(self) -> "RigOwner":
        return self

    def __exit__(self, kind, *exc) -> None:
        try:
            if kind is not None:  # whatever it was: the motors first
                self.stop()
        finally:
            self.close()
