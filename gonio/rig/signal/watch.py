"""Does the rig still see light? Every so many measurements one that was bright is repeated, the lamp is asked how it
is, and the dark is taken again; a reading that repeats bit for bit is no reading.

What is found names the part, the cause and the remedy, and the measurements made since the last good look: they may be
wrong, and cannot be told from good ones by themselves.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gonio.geometry import Array
from gonio.rig.devices import Detector, Light, Reading
from gonio.rig.errors import DeviceFault
from gonio.rig.signal.radiometry import Dark, Radiometry

READINGS = 3  # of a look, lit and dark each: a lamp that flickers shows in their scatter
TOLERANCE = 0.08  # of a repeated measurement: lamps warm up and drift, gears do not come back to the count
DARK_SHARE = 0.01  # of a bright reading: a dark that has changed by less harms nobody
SURE = 6.0  # sigmas
BRIGHT = 20.0  # sigmas above the dark: worth repeating
FIRST = 12  # measurements after which the first look is worth its time
FROZEN = 4  # equal readings in a row
KEPT = 256  # the more there are, the nearer one is
GONE = 0.2  # of the light that was there: less is none


class LostSight(DeviceFault):
    """The rig has not seen what it should since the last good look; `suspect`: ids of the measurements made since."""

    def __init__(self, part: str, cause: str, remedy: str, suspect: list[int]):
        super().__init__(part, cause, f"{remedy}, then `gonio resume`: {len(suspect)} measurements are made again")
        self.suspect = suspect


@dataclass(frozen=True)
class Seen:
    """A measurement worth repeating: pose (A,), light above dark per second (C,) and its sigma."""

    pose: Array
    light: Array
    sigma: Array


class Watch:
    """Of one rig. every: measurements between two looks, 0: never. show(k) draws the noise of simulated devices."""

    def __init__(
        self, detector: Detector, light: Light, radiometry: Radiometry, exposure: float, every: int,
        show: Callable[[int], None],
    ):  # fmt: skip
        self.detector, self.light, self.radiometry = detector, light, radiometry
        self.exposure, self.every, self._show = exposure, every, show
        self.looks = 0
        self.since: list[int] = []
        self._bright: deque[Seen] = deque(maxlen=KEPT)
        self._last: Array | None = None
        self._equal = 1

    @property
    def due(self) -> bool:
        return self._equal >= FROZEN or 0 < self.every <= len(self.since)

    @property
    def due_at_the_end(self) -> bool:
        """Of a block of measurements: before the chain believes them, if it is nearly time, or it was never looked."""
        n = len(self.since)
        return self.every > 0 and (n >= 0.9 * self.every or (self.looks == 0 and n >= FIRST))

    def note(self, number: int, pose: Array, reading: Reading, dark: Dark) -> None:
        """A measurement was made."""
        if not self.every:
            return
        self.since.append(number)
        light, sigma = self._above(reading, dark)
        clear = not reading.saturated and np.isfinite(light).all()
        if clear and light.sum() > 0.25 * BRIGHT * np.sqrt((sigma**2).sum()):
            same = self._last is not None and np.array_equal(self._last, reading.value)
            self._equal = self._equal + 1 if same else 1
            self._last = reading.value.copy()
        if clear and light.sum() > BRIGHT * np.sqrt((sigma**2).sum()):
            self._bright.append(Seen(np.array(pose), light, sigma))

    def refuse_frozen(self) -> None:
        """Raises LostSight where the detector repeats itself."""
        if self._equal >= FROZEN:
            cause = f"gave the same reading {self._equal} times in a row, to the last digit"
            raise LostSight("detector", cause, "switch it off and on", self.since)

    def nearest(self, seconds_to: Callable[[Array], Array]) -> Seen | None:
        """Of the brighter half of what was seen, what is soonest reached: seconds_to(poses (M, A)) -> (M,)."""
        if not self._bright:
            return None
        total = np.array([s.light.sum() for s in self._bright])
        among = [s for s, t in zip(self._bright, total) if t >= np.median(total)]
        return among[int(np.argmin(seconds_to(np.array([s.pose for s in among]))))]

    def look(self, seen: Seen, dark: Dark) -> None:
        """At the pose of `seen`. Raises LostSight; DeviceFault for what the lamp says of itself."""
        self.ask()
        self._show(2 * self.looks)
        lit = [self._above(self.detector.read(self.exposure), dark) for _ in range(READINGS)]
        self._judge_light(seen, np.array([x.sum() for x, _ in lit]), lit[0][1])
        self.light.level(0)
        self._show(2 * self.looks + 1)
        now = Dark.of([self.detector.read(self.exposure) for _ in range(READINGS)])
        self.light.level(1)
        self._judge_dark(seen, dark, now)
        self.since = []

    def ask_only(self) -> None:
        """Where nothing bright was ever seen, as on a black sample or under a cap, a lamp can still say that it burns.
        Raises LostSight."""
        self.ask()
        self.since = []

    def ask(self) -> None:
        """What the lamp says of itself. Raises LostSight."""
        self.looks += 1
        try:
            if (confirm := getattr(self.light, "confirm", None)) is not None:
                confirm()
        except DeviceFault as e:
            raise LostSight(e.axis, e.cause, e.remedy.removesuffix(", then `gonio resume`"), self.since) from None

    def _judge_light(self, seen: Seen, totals: Array, sigma: Array) -> None:
        then, noise = float(seen.light.sum()), float(np.sqrt((sigma**2).sum()))
        uncertain = SURE * float(np.hypot(noise, np.sqrt((seen.sigma**2).sum())))
        if np.ptp(totals) > SURE * noise + TOLERANCE * then:
            raise self._lost("flickers", "check its supply", totals.mean() / then)
        if abs(totals.mean() - then) <= uncertain + TOLERANCE * then:
            return
        ratio = totals.mean() / then
        if ratio < GONE:
            raise self._lost(
                "no longer reaches the detector", "is the lamp burnt out, or a cap on the detector?", ratio
            )
        raise self._lost("has changed", "check its level and supply, and that nothing stands in the way", ratio)

    def _lost(self, what: str, remedy: str, ratio: float) -> LostSight:
        cause = f"what it sends {what}: {ratio:.0%} of what the same pose showed before"
        return LostSight("light", cause, remedy, self.since)

    def _judge_dark(self, seen: Seen, before: Dark, now: Dark) -> None:
        if not np.isfinite(before.value).all():
            return
        change = float((now.value - before.value).sum())
        noise = float(np.sqrt((now.sigma**2 + before.sigma**2).sum()))
        bright = float(seen.light.sum()) * self.exposure
        if abs(change) <= SURE * noise + DARK_SHARE * bright:
            return
        if change > 0.5 * bright:
            raise LostSight("light", "stays on when it is told to go dark", "check its firmware and wiring", self.since)
        cause = f"its dark has changed by {change / bright:+.1%} of a bright reading"
        raise LostSight("detector", cause, "keep other light away, and its temperature steady", self.since)

    def _above(self, reading: Reading, dark: Dark) -> tuple[Array, Array]:
        """Light above dark and its sigma (C,), per second of exposure."""
        seconds = float(reading.raw["exposure_s"])
        value, sigma = self.radiometry.signal(reading)
        return (value - dark.value * seconds / dark.exposure) / seconds, sigma / seconds
