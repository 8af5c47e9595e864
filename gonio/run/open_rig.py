"""Opens the rig that a config describes, at the depth it names. The one place that knows both families of devices."""

from importlib import import_module
from typing import Any

import numpy as np

from gonio.brdf.base import Brdf
from gonio.config.loader import ConfigError
from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.rig.devices import Rig
from gonio.rig.staged import StagedRig

__all__ = ["open_rig"]

LONGEST_POLL_S = 1.0  # rig seconds between two looks at emulated servos on the move, however fast they live


def open_rig(
    config: RigConfig, truth: Brdf | None, seed: int, *, plan: PlanConfig | None = None, isotropic: bool = False
) -> Rig:
    """A rig ready to measure. truth is the BRDF that a simulated rig shows, None for a real one.

    plan says which savings of motion to use (all defaults if None), isotropic whether the sample is, so that a turned
    table and the mirror image show the same. The noise of a simulated rig follows from `seed`.
    Raises ConfigError where truth is given to a real rig or missing for a simulated one; DeviceFault;
    CalibrationMissing.
    """
    plan = plan or PlanConfig()
    if config.depth == "real":
        if truth is not None:
            raise ConfigError(f"truth: rig {config.name} is real and shows what lies on it; leave `truth` out")
        return _family(config, "drivers.rig").open_real(config, plan, isotropic)
    if truth is None:
        raise ConfigError(f"truth: missing; rig {config.name} is simulated and needs a BRDF to show")
    if config.channels not in (None, truth.channels):
        has, shows = config.channels, truth.channels
        if config.detector == "camera":
            raise ConfigError(f"camera.channels: rig {config.name} names {has} planes, the truth has {shows}")
        raise ConfigError(f"detector: rig {config.name} has {has} channels, the truth has {shows}")
    from sim.sample import Sample

    half = np.radians([config.acceptance.light_half_angle_deg, config.acceptance.detector_half_angle_deg])
    sample = Sample(truth, *half.tolist())
    if config.depth == "ideal":
        from sim.ideal import IdealRig

        return IdealRig(config, sample, plan, isotropic)
    if config.depth == "devices":
        from sim.rig import open_sim

        driver = lambda: _family(config, "drivers.rig").camera_detector
        over = lambda frames, pose: driver()(config, frames, pose, even=frames.even)
        return open_sim(config, sample, seed, plan, isotropic, over)
    return _open_wire(config, sample, seed, plan, isotropic)


class WireRig(StagedRig):
    """A rig of real drivers whose devices are emulated, in this very process: their state is part of the run's."""

    emulators: Any = None

    def state(self) -> dict[str, Any]:
        return {**super().state(), "shafts": self.emulators.state()}

    def restore(self, state: dict[str, Any]) -> None:
        super().restore(state)
        self.emulators.restore(state["shafts"])

    def close(self) -> None:
        try:
            super().close()
        finally:
            self.emulators.close()


def _open_wire(config: RigConfig, sample, seed: int, plan: PlanConfig, isotropic: bool) -> WireRig:
    emulators = _family(config, "sim.wire.rig").Emulators(config, sample, seed)
    try:
        frames = _frames(config, emulators, sample, seed) if config.detector == "camera" else None
        announce = lambda number: [each.announce(number) for each in (emulators, frames) if each]
        rig = _family(config, "drivers.rig").assemble(
            emulators.config, emulators.devices, plan, isotropic, emulators.clock,
            simulated=True, announce=announce, rig_of=WireRig, frames=frames, even=frames.even if frames else None,
        )  # fmt: skip
    except BaseException:
        emulators.close()
        raise
    rig.emulators = emulators
    if (poll_s := getattr(rig.stage, "poll_s", None)) is not None:
        rig.stage.poll_s = min(poll_s, LONGEST_POLL_S)
    return rig


def _frames(config: RigConfig, emulators, sample, seed: int):
    """A camera has no bytes to emulate: its frames are made, of where the emulated servos are."""
    from sim.lit_patch import frames_of

    pose = lambda: np.radians(emulators.angles_deg())
    return frames_of(config, sample, pose, emulators.light.lamp, emulators.clock, seed)


def _family(config: RigConfig, module: str):
    """The module that opens rigs of this depth. Raises ConfigError where it is not installed."""
    try:
        return import_module(module)
    except ModuleNotFoundError as e:
        raise ConfigError(
            f"depth: rig {config.name} is {config.depth} and needs {e.name}, which is not installed"
        ) from None
