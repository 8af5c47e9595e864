"""What a camera sees of a simulated rig's sample: the patch that the lamp lights, foreshortened, in a dark room."""

from collections.abc import Callable

import numpy as np

from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.build import envelope_of, geometry_calibration, view_of
from gonio.rig.clock import Clock
from gonio.rig.kinematics.base import Kinematics
from gonio.rig.signal.view import View, rotation_of
from sim.board_on_plate import BoardOnPlate
from sim.camera import SimFrames
from sim.light import SimLight
from sim.sample import Sample


def frames_of(
    config: RigConfig, sample: Sample, pose: Callable[[], Array], lamp: SimLight, clock: Clock, seed: int
) -> SimFrames:
    """The sensor of a simulated rig, mounted as `camera.sensor` says; pose() is where the arms really are."""
    c, geometry = config.camera, geometry_calibration(config)
    view = astray(view_of(config, geometry), c.sensor.aim_deg, c.sensor.shift_mm)
    scene = LitPatch(config, sample, envelope_of(config, geometry).kinematics, view, pose, lamp.power)
    shape = c.height, c.width, max(c.channels) + 1
    return SimFrames(scene, c.sensor, shape, clock, c.frame_s, seed, config.faults.silent_detector)


class LitPatch:
    """Call it for the picture (H, W, P) of now, in electrons per second and pixel.

    The f of the patch's middle stands for all of it. pose() is where the arms really are, power() the lamp's.
    """

    def __init__(
        self,
        config: RigConfig,
        sample: Sample,
        kinematics: Kinematics,
        view: View,
        pose: Callable[[], Array],
        power: Callable[[], float],
    ):
        self.config, self.sample, self.kinematics, self.view = config, sample, kinematics, view
        self.pose, self.power = pose, power
        self._seen: tuple[bytes, Array] | None = None  # a pose, and the picture of it at full power

    def __call__(self) -> Array:
        power = self.power()
        if power == 0:
            return np.zeros(max(self.config.camera.channels) + 1)
        at = self.pose()
        if self._seen is None or self._seen[0] != at.tobytes():
            self._seen = at.tobytes(), self._picture(at)
        return power * self._seen[1]

    def _picture(self, at: Array) -> Array:
        c = self.config.camera
        wi, wo = self.kinematics.forward(at)
        f = self.sample.eval(wi[None], wo[None])[0]
        rate = np.zeros(max(c.channels) + 1)
        rate[list(c.channels)] = np.pi * c.sensor.white_per_s * max(wi[2], 0.0) * f
        x, y = np.moveaxis(self.view.on_sample(at), -1, 0)
        if isinstance(board := self.sample.truth, BoardOnPlate):
            shown = board.texture(x, y, c.distance_mm / 1000 / c.focal_px)
            return np.nan_to_num(shown)[..., None] * rate
        lit = np.hypot(x, y) <= c.lit_mm / 2000  # NaN, past the horizon, is not lit
        return lit[..., None] * rate


def astray(view: View, aim_deg: tuple[float, float, float], shift_mm: tuple[float, float, float]) -> View:
    """The view of a camera that is not mounted as drawn."""
    turn = rotation_of(np.radians(aim_deg))
    at = turn @ view.translation + np.array(shift_mm) / 1000
    return View(view.matrix, view.distortion, view.size, turn @ view.rotation, at, view.arm)
