"""All that a run needs before anything moves, found and looked at: what is refused here costs no rig time.

`gonio check` and `gonio acquire` go through the same door, so that a plan that cannot start is no plan.
"""

import os
import secrets
import time
from dataclasses import dataclass
from pathlib import Path

from gonio.brdf import Brdf
from gonio.config import ConfigError, Material
from gonio.config.fit import refuse_misfit
from gonio.config.instrument import TextSection
from gonio.config.plugins import DeviceSection, names
from gonio.config.rig import RigConfig
from gonio.mcmc import make_sampler
from gonio.rig.build import (
    camera_calibration,
    camera_frames,
    envelope_of,
    geometry_calibration,
    radiometry_of,
)
from gonio.rig.motion.envelope import Envelope
from gonio.run.record.folder import refuse_folder
from gonio.run.truth import find_truth


@dataclass(frozen=True)
class Prepared:
    """folder: that of the run, not made yet. truth: the BRDF that a simulated rig shows and in words where it was
    found; None and "" on a real rig."""

    folder: Path
    truth: Brdf | None
    origin: str
    envelope: Envelope


def prepare(material: Material, rig: RigConfig, out: Path | None = None, own: Brdf | None = None) -> Prepared:
    """Everything for a run in `out` (None: runs/<material>/<UTC stamp>-<short id>); nothing is made. own: a truth that
    no file holds.

    Raises StoreError, ConfigError, BrdfFileError, FlowError, PriorError, CalibrationMissing, NoSupport: whatever would
    keep a run from starting, but for the devices themselves.
    """
    folder = out or Path("runs") / material.name / new_name()
    refuse_folder(folder)
    refuse_misfit(material, rig)
    _refuse_missing_devices(rig)
    truth, origin = find_truth(material, rig, own)
    if truth is not None and truth.channels != len(material.channels):
        raise ConfigError(f"channels: {len(material.channels)} named, but the truth ({origin}) has {truth.channels}")
    if material.sampler.flow.weights is not None:
        from gonio.flow import shipped

        shipped.load_conditional(material.sampler.flow.weights)
    if os.environ.get("GONIO_PRIOR"):
        from gonio.reconstruct import prior

        prior.shipped()
    envelope = envelope_of(rig, geometry_calibration(rig))
    if rig.depth != "ideal":
        radiometry_of(rig, len(material.channels))
        if rig.detector == "camera":
            camera_calibration(rig)
            camera_frames(rig)
    make_sampler(material, envelope.reachable).ask()
    return Prepared(folder, truth, origin, envelope)


def new_name() -> str:
    """A run's own, in the folder of its material: when, and a few digits so that two of a second do not meet."""
    return f"{time.strftime('%Y%m%dT%H%M%SZ', time.gmtime())}-{secrets.token_hex(2)}"


def _refuse_missing_devices(rig: RigConfig) -> None:
    """Raises ConfigError where a real rig names no port for a device that it cannot do without."""
    detector = rig.detector
    for key, section in (
        ("detector", detector),
        ("devices.stage", rig.devices.stage),
        ("devices.light", rig.devices.light),
    ):
        if isinstance(section, DeviceSection) and not section.known:
            known = ", ".join(names(section.group))
            raise ConfigError(f"{key}.driver: {section.driver} is not installed; there is {known}")
    if rig.depth == "wire" and isinstance(detector, TextSection):
        from sim.wire.instruments import refuse_unknown

        refuse_unknown(detector.instrument.name)
    if rig.depth != "real":
        return
    for name in ("stage", *([detector] if isinstance(detector, str) else [])):
        if getattr(rig.devices, name) is None:
            raise ConfigError(f"devices.{name}: missing; rig {rig.name} is real, name where it is connected")
