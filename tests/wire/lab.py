"""A rig of depth `real` whose ports lead to emulators in this process: they outlive the process that drives them."""

import datetime as dt
import json
import os

import numpy as np

from gonio.brdf.models.lambert import Lambert
from gonio.config import load_config
from gonio.config.detectors import PhotodiodeConfig
from gonio.config.devices import ServoBusConfig
from gonio.config.rig import RigConfig
from gonio.rig.calibration import RadiometryCalibration, save_calibration
from sim.sample import Sample
from sim.wire.rig import Emulators
from tests.conftest import ROOT

WIRE = load_config(ROOT / "configs/rigs/wire.yaml", RigConfig)
QUIET = PhotodiodeConfig(shot_noise=0, read_noise=0, dark=0)  # a reading follows from the pose alone

# a rig is driven by one process at a time, whatever folder it runs from: each worker of the suite has its own
NAME = "lab" + os.environ.get("PYTEST_XDIST_WORKER", "")


class Lab:
    """`yaml`: the rig's file; `emulators`: what is on its ports. speed: of the axes, in degrees a second."""

    def __init__(self, folder, truth=None, *, speed=3600.0, exposure=0.001, **changes):
        truth = truth or Lambert([0.3, 0.2, 0.1])
        names = list(WIRE.axis_names)
        fast = {"velocity_deg_s": speed, "acceleration_deg_s2": 10 * speed}
        config = WIRE.model_copy(
            update={
                "name": NAME,
                "clock_scale": 1.0,
                "axes": {k: a.model_copy(update=fast) for k, a in WIRE.axes.items()},
                "settle_s": 0.0,
                "exposure_s": exposure,
                "photodiode": QUIET,
                "devices": WIRE.devices.model_copy(
                    update={"stage": ServoBusConfig(port="-", ids={n: k for k, n in enumerate(names, 1)})}
                ),
                **changes,
            }
        )
        self.emulators = Emulators(config, Sample(truth, 0.0, 0.0), 1)
        now = dt.datetime.now(dt.UTC)
        gain = (float(np.pi / exposure),) * truth.channels
        made = RadiometryCalibration(id="radiometry-lab", date=now, rig=NAME, gain=gain, gain_sigma=(0.0,) * 3)
        real = json.loads(config.model_dump_json(exclude={"clock_scale", "faults"}))
        real |= {
            "depth": "real",
            "devices": json.loads(self.emulators.devices.model_dump_json(exclude_none=True)),
            "calibration": {"radiometry": str(save_calibration(made, folder))},
        }
        self.yaml = folder / "lab.yaml"
        self.yaml.write_text(json.dumps(real))
        self.material = folder / "felt.yaml"
        chains = {"proposal": "pss_simple", "chains": 16}
        self.material.write_text(json.dumps({"name": "felt", "channels": ["R", "G", "B"], "sampler": chains}))

    def acquire(self, measurements, out):
        sets = ["--set", f"budget.measurements={measurements}"]
        return ["acquire", self.material, "--rig", self.yaml, "--no-post", "--no-daemon", *sets, "--out", out]

    @property
    def lit(self):
        return self.emulators.light.lamp.lit

    def still(self):
        """Whether no servo is on its way."""
        now = self.emulators.clock.now()
        return all(s.position(now) == s.position(now + 100) for s in self.emulators.servos.values())

    def close(self):
        self.emulators.close()
