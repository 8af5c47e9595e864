"""A rig calibrates itself by a flat mirror: it looks for the peak where that tells most, until nothing more is told."""

from collections.abc import Callable
from functools import partial

import numpy as np

from calibration.geometry.design import Candidates, at_best, best, candidates
from calibration.geometry.fit import Fit, apart, fit_geometry, misses_of, random_poses
from calibration.geometry.looking import Looking
from calibration.geometry.observations import Observation
from calibration.geometry.parameters import Parameters
from calibration.geometry.peak import NoPeak, OutOfReach, find_peak
from calibration.geometry.slip import slipped
from gonio.config.rig import RigConfig
from gonio.geometry import Array
from gonio.rig.errors import CalibrationMissing
from gonio.rig.motion.envelope import Envelope
from gonio.rig.motion.profile import move_time
from gonio.rig.staged import StagedRig

GOAL = np.radians(0.05)  # of a parameter
USUAL = np.radians(0.007)  # sigma of a half vector that is expected before it is known
BATCH, FEWEST, MOST, HELD_OUT = 6, 18, 48, 8  # peaks
TRIES = 40  # batches
FIRST = np.radians(14.0)  # radius of the search for the first peak of a mirror
LEVEL = np.radians(6.0)  # a mirror that lies worse than this is not lying on the plate
NOISE = 4.0  # a fit worse than its noise by this factor is no fit
NUMBERS = -(1 << 43)  # ids of what is read here, downwards


class Session:
    """Peaks of one rig, of mirror after mirror. say(text) tells the operator."""

    def __init__(self, config: RigConfig, wedges: tuple[Array, ...] = (), say: Callable[[str], None] = lambda s: None):
        self.config, self.say = config, say
        self.parameters = Parameters(config, wedges)
        size = len(self.parameters)
        self.fit = Fit(self.parameters, np.zeros(size), np.diag(self.parameters.prior**2), np.zeros((0, 3)), 0.0, 1.0)
        self.observations: list[Observation] = []
        self.held_out: list[Observation] = []
        self.reachable_sigma = self.parameters.prior.copy()  # what mirrors so far could tell each parameter to

    def measure(self, rig: StagedRig, mirror: int, seed: int = 0) -> None:
        """Find peaks of mirror `mirror`, which lies there now, until it tells nothing more; then some to be held out.

        The lamp is off afterwards. Raises CalibrationMissing, SafetyStop, DeviceFault.
        """
        rng = np.random.default_rng([seed, mirror])
        try:
            looking = Looking(rig, NUMBERS - 1000 * mirror)
            found = tries = 0
            while found < MOST and tries < TRIES:
                tries += 1
                at = self._candidates(rig, mirror, rng)
                self.reachable_sigma = np.minimum(self.reachable_sigma, at_best(self.fit, at, self._usual))
                told = self.reachable_sigma <= GOAL
                if found >= FEWEST and not (told & (self.fit.sigma > GOAL)).any():
                    break
                goal = np.where(told, GOAL, np.inf)
                picks = best(self.fit, at, self._usual, goal, 1 if found == 0 else BATCH)
                found += self._visit(looking, at, picks, mirror, found)
            if found < FEWEST:
                raise CalibrationMissing(
                    f"geometry: of mirror {mirror} only {found} peaks lie within reach; widen the axes' limits"
                )
            at = self._candidates(rig, mirror, rng)
            plain = np.flatnonzero(~at.down.any(1))[:HELD_OUT]
            self._visit(looking, at, plain, mirror, found, self.held_out)
        finally:
            rig.light.off()

    @property
    def held_out_rms(self) -> float:
        """Of the half vectors of peaks that the fit has not seen, rad."""
        return float(np.sqrt(np.mean(misses_of(self.held_out, self.fit) ** 2))) if self.held_out else 0.0

    def confirm(self) -> None:
        """Raises CalibrationMissing where the fit does not explain what was seen, and says what would."""
        expected = np.sqrt(np.mean([(o.sigma or USUAL) ** 2 for o in (*self.observations, *self.held_out)]))
        worst = max(self.fit.excess, self.held_out_rms / (2 * max(expected, USUAL)))
        if worst > NOISE:
            raise CalibrationMissing(
                f"geometry: no rig explains the peaks: they miss it by {np.degrees(self.fit.rms):.2f} degrees, "
                f"held-out ones by {np.degrees(self.held_out_rms):.2f}; {slipped(self.observations, self.fit)}"
            )

    @property
    def untold(self) -> dict[str, float]:
        """Parameters that no mirror so far could tell, and their sigmas."""
        names, sigma = self.parameters.names, self.fit.sigma
        return {n: s for n, s, r in zip(names, sigma, self.reachable_sigma) if r > GOAL}

    def only_turns(self, name: str) -> bool:
        """Whether a parameter does nothing but turn all directions about the sample's normal."""
        step = np.where(np.array(self.parameters.names) == name, 0.01, 0.0)
        poses = random_poses(self.config, 50, np.random.default_rng(0))
        return bool(apart(self.fit.kinematics, self.parameters.kinematics(self.fit.p + step), poses).max() < 0.1 * 0.01)

    @property
    def _usual(self) -> float:
        """Of a half vector, as seen so far."""
        seen = [o.sigma for o in self.observations if o.sigma is not None]
        return max(float(np.median(seen)), USUAL) * max(self.fit.excess, 1.0) if seen else USUAL

    def _candidates(self, rig: StagedRig, mirror: int, rng: np.random.Generator) -> Candidates:
        e = rig.envelope
        known = Envelope(self.fit.kinematics, e.axes, e.stay_out)
        at = candidates(self.fit, known, mirror, 400, rng)
        if not len(at.poses):
            raise CalibrationMissing(
                f"geometry: rig {self.config.name} reaches no pose at which a mirror throws the light into its detector"
            )
        return at

    def _visit(
        self,
        looking: Looking,
        at: Candidates,
        picks: np.ndarray,
        mirror: int,
        found: int,
        into: list[Observation] | None = None,
    ) -> int:
        """Observe poses in the order of least travel; how many."""
        seen = self.observations if into is None else into
        looking.believe(self.fit, mirror)
        left, n = list(picks), 0
        while left:
            rig = looking.rig
            seconds = move_time(at.poses[left] - rig.stage.pose(), rig.planner.velocity, rig.planner.acceleration)
            k = left.pop(int(np.argmin(seconds)))
            first = found + n == 0
            radius = FIRST if first else self._radius(at, k)
            find = partial(find_peak, radius=radius, alone=first)
            try:
                seen.append(looking.observe(at.poses[k], at.down[k], find))
            except OutOfReach:
                continue
            except NoPeak as e:
                where = "  ".join(f"{a} {v:.1f}" for a, v in zip(self.config.axis_names, np.degrees(at.poses[k])))
                raise CalibrationMissing(f"geometry: {e} (near {where} degrees, mirror {mirror})") from None
            n += 1
            kind = "held out" if into is not None else f"at most {MOST}"
            known = np.degrees(self.fit.directions_sigma)
            self.say(f"mirror {mirror + 1}, peak {found + n} ({kind}); a direction is known to {known:.2g} degrees")
        if into is None and n:
            self.fit = fit_geometry(self.observations, self.parameters, self.fit.p)
            lie = np.hypot(*self.parameters.of(self.fit.p, "lie"))
            if mirror == 0 and lie > LEVEL and found:
                raise CalibrationMissing(
                    f"geometry: the mirror lies {np.degrees(lie):.1f} degrees from level; lay it flat where samples lie"
                )
        return n

    def _radius(self, at: Candidates, k: int) -> float:
        """How far from where it is expected a peak may be, rad."""
        j = at.jacobian[k]
        return float(6 * np.sqrt(np.trace(j @ self.fit.covariance @ j.T) / 2) + np.radians(1.5))
