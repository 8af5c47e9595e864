"""The simulated rig of depth `devices`: devices with dynamics, noise and faults, on a virtual clock."""

import numpy as np

from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import envelope_of, geometry_calibration, park_pose, radiometry_of
from gonio.rig.clock import VirtualClock
from gonio.rig.staged import StagedRig
from sim.light import SimLight
from sim.photodiode import SimPhotodiode
from sim.sample import Sample
from sim.stage import SimStage


def open_sim(config: RigConfig, sample: Sample, seed: int, plan: PlanConfig, isotropic: bool) -> StagedRig:
    """A rig that shows `sample`; its noise follows from seed and the measurements' ids, homed and ready."""
    geometry, radiometry = geometry_calibration(config), radiometry_of(config, sample.channels)
    clock, envelope = VirtualClock(), envelope_of(config, geometry)
    backlash = np.radians([config.axes[name].backlash_deg for name in config.axis_names])
    faults = config.faults
    stage = SimStage(envelope.axes, backlash, envelope.snap(park_pose(config)), faults, clock, seed)
    stage.home()
    light = SimLight(config.light, clock)

    def scene() -> Array:
        power = light.power()
        if power == 0:
            return np.zeros(sample.channels)
        wi, wo = envelope.kinematics.forward(stage.true_pose())
        cosine = wi[2] if config.photodiode.footprint == "overfilled" else wo[2]
        return np.pi * power * max(cosine, 0.0) * sample.eval(wi[None], wo[None])[0]

    detector = SimPhotodiode(
        config.photodiode, scene, clock, config.exposure_s, seed, silent=faults.silent_detector, spike=faults.spike
    )

    def announce(number: int) -> None:
        stage.announce(number)
        detector.announce(number)

    rig = StagedRig(
        config, envelope, stage, detector, light, radiometry, clock, plan, isotropic, simulated=True, announce=announce
    )
    rig.calibration_ids = {k: c.id for k, c in (("geometry", geometry), ("radiometry", radiometry)) if c and c.id}
    return rig
