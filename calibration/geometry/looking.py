"""Looks at a mirror's peak with a rig: drives beside it, always from the sides asked for, and reads."""

from collections.abc import Callable

import numpy as np

from calibration.geometry.fit import Fit
from calibration.geometry.observations import Observation
from calibration.geometry.peak import Look, OutOfReach, Peak
from gonio.geometry import Array, reflect, unit
from gonio.rig.errors import CalibrationMissing
from gonio.rig.motion.approach import Approach
from gonio.rig.motion.driver import Driver
from gonio.rig.staged import StagedRig

ROOM = np.radians(0.8)  # from where a pose is approached: more than any backlash
DARKS = 16
LEAST = np.radians(0.003)  # sigma of a half vector: what a peak's shape, and the joints, leave open
FAINTEST = 1 / 512  # of the lamp, or of the exposure


class Looking:
    """One rig with its lamp on. What it believes of its geometry is a fit's, and gets better."""

    def __init__(self, rig: StagedRig, number: int):
        self.rig, self.number = rig, number
        e = rig.envelope
        plain = Approach(e, np.zeros(len(e.axes)), "never", False)
        self.driver = Driver(rig.config.name, rig.stage, e, plain, rig.planner, rig.driver.stopped)
        self.sides = np.zeros(len(e.axes))  # from where each axis came: 1 below, -1 above, 0 not known
        self.power, self.seconds = 1.0, rig.config.exposure_s
        rig.light.on()
        rig.light.level(1)
        self._read_dark()

    def believe(self, fit: Fit, mirror: int) -> None:
        """The fit by which poses are found from now on, and which mirror lies there."""
        self.fit, q = fit, fit.parameters
        self.normal, self.lag = q.normal(fit.p, mirror), q.of(fit.p, "backlash")
        self.mirror = mirror

    def observe(self, pose: Array, down: np.ndarray, find: Callable[[Look], Peak]) -> Observation:
        """The peak near an encoder pose (A,), every axis from below but those `down` (A,)."""
        kinematics, lag = self.fit.kinematics, self.lag * down
        wi, wo = (w[0] for w in kinematics.forward((pose + lag)[None]))
        x = unit(np.cross(wo, np.eye(3)[int(np.abs(wo).argmin())]))
        across = np.stack([x, np.cross(wo, x)])

        def to(w: Array) -> Array:
            """The encoder pose that looks w (2,) beside the mirror image of wi."""
            there = unit(reflect(wi[None], self.normal[None])[0] + w @ across)
            ways = kinematics.inverse(wi[None], there[None], pose + lag)[0] - lag
            ways = ways[np.isfinite(ways).all(-1)]
            ways += 2 * np.pi * np.rint((pose - ways) / (2 * np.pi))
            return np.asarray(ways[np.abs(ways - pose).sum(-1).argmin()])

        def look(w: Array) -> tuple[Array, float, float]:
            there = self.rig.envelope.snap(to(w))
            if not self.rig.envelope.inside(there):
                raise OutOfReach  # the rest of this peak lies where the rig cannot be
            at = self.go(there, down)
            a, b = (v[0] for v in kinematics.forward((at + lag)[None]))
            signal, sigma = self.read()
            return across @ (b - reflect(a[None], self.normal[None])[0]), signal, sigma

        peak = find(look)
        sigma = float(np.hypot(np.sqrt(np.trace(peak.covariance) / 8), LEAST))
        return Observation("mirror", to(peak.centre), None, sigma, down.copy(), self.mirror)

    def go(self, pose: Array, down: np.ndarray) -> Array:
        """Drive there so that each axis comes from below, or from above where `down`; what the encoders show."""
        want = np.where(down, -1.0, 1.0)
        here = self.rig.stage.pose()
        delta = (pose - here) * want
        wrong = (delta < -1e-9) | ((self.sides != want) & (delta < ROOM))
        if not self.rig.envelope.path_clear(here[None], pose[None])[0]:
            wrong[:] = True  # a way round the cone may come from anywhere
        if wrong.any():
            low, high = self.rig.envelope.lower, self.rig.envelope.upper
            before = np.clip(np.where(wrong, pose - want * ROOM, pose), low, high)
            self._drive(self.rig.envelope.snap(before))
        at = self._drive(pose)
        self.sides = want
        return at

    def read(self) -> tuple[float, float]:
        """Signal of all channels above dark, per nominal lamp and exposure, and its sigma."""
        while True:
            self.rig.announce(self.number)
            self.number -= 1
            reading = self.rig.detector.read(self.seconds)
            if not reading.saturated:
                break
            if min(self.power, self.seconds / self.rig.config.exposure_s) < FAINTEST:
                raise CalibrationMissing(
                    "geometry: the peak saturates the detector at its faintest; put a filter before the lamp"
                )
            self._fainter()
        scale = self.power * self.seconds / self.rig.config.exposure_s
        value, sigma = self.rig.radiometry.signal(reading)
        value = value - self.dark * self.seconds
        return float(value.sum() / scale), float(np.sqrt((sigma**2).sum() + self.dark_noise**2) / scale)

    def _fainter(self) -> None:
        """A quarter of the lamp; of the exposure, once the lamp is as low as lamps go."""
        if self.power > 1 / 16:
            self.power /= 4
            self.rig.light.level(self.power)
        else:
            self.seconds /= 4

    def _read_dark(self) -> None:
        self.rig.light.level(0)
        self.rig.announce(self.number)
        self.number -= 1
        readings = [self.rig.detector.read(self.seconds) for _ in range(DARKS)]
        self.rig.light.level(self.power)
        self.dark = np.mean([r.value for r in readings], 0) / self.seconds
        self.dark_noise = float(np.sqrt(np.mean([(r.sigma**2).sum() for r in readings]) / DARKS))

    def _drive(self, pose: Array) -> Array:
        at = self.driver.go(pose)
        if at is None:
            raise OutOfReach
        if self.driver.stopped.is_set():
            raise KeyboardInterrupt
        self.rig.clock.sleep(self.rig.config.settle_s)
        return at
