"""The simulated rig of depth `devices`: devices with dynamics, noise and faults, on a virtual clock."""

from collections.abc import Callable

import numpy as np

from gonio.config.plan import PlanConfig
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import backlash_of, calibration_ids, envelope_of, geometry_calibration, park_pose, radiometry_of
from gonio.rig.clock import VirtualClock
from gonio.rig.devices import Detector
from gonio.rig.staged import StagedRig
from sim.camera import SimFrames
from sim.light import SimLight
from sim.lit_patch import frames_of
from sim.photodiode import SimPhotodiode
from sim.sample import Sample
from sim.stage import SimStage
from sim.world import TrueRig

# a camera's driver is the same for real and simulated sensors: it is put on top of the frames by whoever knows both
OverFrames = Callable[[SimFrames, Callable[[], Array]], Detector]


def open_sim(
    config: RigConfig, sample: Sample, seed: int, plan: PlanConfig, isotropic: bool, over_frames: OverFrames
) -> StagedRig:
    """A rig that shows `sample`; its noise follows from seed and the measurements' ids, homed and ready.

    over_frames(frames, pose) is the detector where it is a camera; pose() what the encoders say.
    """
    geometry, radiometry = geometry_calibration(config), radiometry_of(config, sample.channels)
    clock, envelope = VirtualClock(), envelope_of(config, geometry)
    true = None if config.world is None else TrueRig(config, sample.channels)
    backlash = backlash_of(config, geometry) if true is None else true.backlash
    faults = config.faults
    stage = SimStage(envelope.axes, backlash, envelope.snap(park_pose(config)), faults, clock, seed)
    stage.home()
    light = SimLight(config.light, clock)

    def scene() -> Array:
        power, share = light.power(), 1.0
        if power == 0:
            return np.zeros(sample.channels)
        if true is None:
            wi, wo = envelope.kinematics.forward(stage.true_pose())
        else:
            wi, wo, share = true.seen(stage.true_pose())
        cosine = wi[2] if config.footprint == "overfilled" else wo[2]
        shown = np.pi * power * share * max(cosine, 0.0) * sample.eval(wi[None], wo[None])[0]
        return shown if true is None else true.signal(shown, clock.now(), power)

    detector: Detector
    if config.detector == "camera":
        sensor = frames_of(config, sample, stage.true_pose, light, clock, seed)
        detector, draw = over_frames(sensor, stage.pose), sensor.announce
    else:
        photodiode = SimPhotodiode(
            config.photodiode,
            scene,
            clock,
            config.exposure_s,
            seed,
            silent=faults.silent_detector,
            spike=faults.spike,
            true=true,
        )
        detector, draw = photodiode, photodiode.announce

    def announce(number: int) -> None:
        stage.announce(number)
        draw(number)

    rig = StagedRig(
        config, envelope, stage, detector, light, radiometry, clock, plan, isotropic, simulated=True, announce=announce
    )
    rig.calibration_ids = calibration_ids(config, geometry, radiometry)
    return rig
