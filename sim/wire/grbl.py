"""An emulated Grbl 1.1 controller: one line at a time is carried out, real-time characters come between.

After Grbl's own source and its wiki ("Grbl v1.1 Interface"): states, `$$`, homing, soft limits, feed hold, soft reset.
"""

import math
import re
from collections.abc import Sequence

import numpy as np

from gonio.geometry import Array
from gonio.rig.clock import ScaledClock

LETTERS = "XYZABC"
BANNER = "Grbl 1.1h ['$' for help]"
WORD = re.compile(r"([A-Z])([-+]?\d*\.?\d+)")
HOMING_S = 8.0


class GrblController:
    """Implements `sim.wire.line.Device`. travel, rate (units/min), acceleration (units/s2): of each axis.

    stuck: an axis that hits a switch on its next move. deaf_to: packets lost while it starts. lost_switch: homing does
    not find one; endless: homing goes on until it is reset. frozen: no motor turns.
    """

    def __init__(
        self,
        travel: Sequence[float],
        rate: Sequence[float],
        acceleration: Sequence[float],
        clock: ScaledClock,
        *,
        pull_off: float = 5.0,
        homing: bool = True,
        banner: str = BANNER,
    ):
        n = len(travel)
        self.clock, self.banner, self.busy_s = clock, banner, 0.0
        self.settings: dict[int, float] = {1: 255, 10: 1, 20: 1, 21: 0, 22: float(homing), 27: pull_off}
        for first, values in ((130, travel), (110, rate), (120, acceleration)):
            self.settings |= {first + k: float(v) for k, v in enumerate(values)}
        self.deaf_to, self.stuck, self.lost_switch, self.frozen, self.silent = 0, False, False, False, False
        self.endless = False
        self.lines: list[str] = []
        self._held: tuple[float, Array] | None = None  # when and where a hold comes to rest
        self.at = np.zeros(n)  # machine position where the last motion ended
        self.power_on()

    def power_on(self) -> None:
        self._buffer = ""
        self.state = "Alarm" if self.settings[22] else "Idle"
        self._stand(np.zeros(len(self.at)))

    def restarted(self) -> None:
        """Its port was opened anew: an Arduino begins from the beginning."""
        if self.deaf_to:
            self.power_on()

    # ---- bytes -----------------------------------------------------------------------------------------------------

    def receive(self, data: bytes) -> list[bytes]:
        self.busy_s = 0.0
        if self.deaf_to > 0:
            self.deaf_to -= 1
            self._buffer = ""
            return [f"\r\n{self.banner}\r\n".encode()] if self.deaf_to == 0 else []
        out: list[str] = []
        for c in data.decode("latin-1"):
            if c in "?!~\x18":
                out += self._real_time(c)
            elif c in "\r\n":
                line, self._buffer = self._buffer.strip(), ""
                if line:
                    self.lines.append(line)
                    out += self._obey(line)
            else:
                self._buffer += c
        return [] if self.silent or not out else ["".join(f"{text}\r\n" for text in out).encode()]

    def _real_time(self, c: str) -> list[str]:
        self._settle()
        if c == "?":
            code = ":0" if self.state == "Hold" and self._still else ":1" if self.state == "Hold" else ""
            place = ",".join(f"{x:.3f}" for x in self.position())
            name = "MPos" if self.settings[10] else "WPos"
            return [f"<{self.state}{code}|{name}:{place}|FS:0,0>"]
        if c == "!" and self.state in ("Idle", "Run"):
            if self.state == "Run":
                self._brake()
            self.state = "Hold"
        elif c == "\x18":
            if self.state == "Home":
                self.state = "Alarm"
                return ["ALARM:6", "", self.banner]
            moving = self.state in ("Run", "Hold") and not self._still
            self._stand(self.position())
            self._buffer = ""
            if moving:
                self.state = "Alarm"
                return ["ALARM:3", "", self.banner]
            self.state = "Idle" if self.state in ("Run", "Hold") else self.state
            return ["", self.banner]
        return []

    def _obey(self, line: str) -> list[str]:
        self._settle()
        if line == "$$":
            return [*(f"${k}={v:.3f}" for k, v in sorted(self.settings.items())), "ok"]
        if line == "$H":
            return self._home()
        if line.startswith("$"):
            return ["error:3"]
        words = [(m[1], float(m[2])) for m in WORD.finditer(line.replace(" ", ""))]
        if not words or "".join(f"{a}" for a, _ in words) == "":
            return ["error:1"]
        if self.state == "Alarm":
            return ["error:9"]
        codes = {(a, v) for a, v in words if a == "G"}
        if not codes <= {("G", 90.0), ("G", 53.0), ("G", 1.0), ("G", 0.0)}:
            return ["error:20"]
        goal, feed = self.position(), None
        for letter, value in words:
            if letter == "F":
                feed = value
            elif letter in LETTERS[: len(goal)]:
                goal[LETTERS.index(letter)] = value
            elif letter != "G":
                return ["error:20"]
        if ("G", 1.0) in codes and not feed:
            return ["error:22"]
        travel = np.array([self.settings[130 + k] for k in range(len(goal))])
        if self.settings[20] and ((goal > 1e-6) | (goal < -travel - 1e-6)).any():
            self.state = "Alarm"
            return ["ALARM:2", "ok"]
        if self.stuck:
            self.stuck, self.state = False, "Alarm"
            return ["ok", "ALARM:1"]
        self._start(goal, feed or math.inf)
        return ["ok"]

    def _home(self) -> list[str]:
        if not self.settings[22]:
            return ["error:5"]
        self.busy_s = self.clock.hurry(HOMING_S)
        if self.endless:
            self.busy_s, self.state = 0.0, "Home"
            return []
        if self.lost_switch:
            self.state = "Alarm"
            return ["ALARM:9"]
        self._stand(np.full(len(self.at), -self.settings[27]))
        self.state = "Idle"
        return ["ok"]

    # ---- motion ----------------------------------------------------------------------------------------------------

    def _start(self, goal: Array, feed: float) -> None:
        """A trapezoid along the line, no axis beyond its rate or acceleration."""
        here = self.position()
        way = goal - here
        length = float(np.linalg.norm(way))
        if length < 1e-9 or self.frozen:
            return
        unit = np.abs(way) / length
        limit = lambda first: min(self.settings[first + k] / u for k, u in enumerate(unit) if u > 1e-12)
        self._v, self._a = min(feed, limit(110)) / 60, limit(120)
        self._from, self._way, self._length = here, way / length, length
        self._begun, self.state = self.clock.now(), "Run"
        ramp = self._v**2 / self._a
        self._seconds = length / self._v + self._v / self._a if length > ramp else 2 * math.sqrt(length / self._a)

    def _along(self, t: float) -> tuple[float, float]:
        """Way and speed after t seconds."""
        total, a = self._seconds, self._a
        ramp = min(self._v / a, total / 2)
        if t <= 0:
            return 0.0, 0.0
        if t >= total:
            return self._length, 0.0
        if t < ramp:
            return 0.5 * a * t * t, a * t
        if total - t < ramp:
            return self._length - 0.5 * a * (total - t) ** 2, a * (total - t)
        return 0.5 * a * ramp**2 + (t - ramp) * self._v, self._v

    def _brake(self) -> None:
        way, speed = self._along(self.clock.now() - self._begun)
        stop = min(way + speed**2 / (2 * self._a), self._length)
        self._held = self.clock.now() + speed / self._a, self._from + self._way * stop
        self._braking = way, speed, self.clock.now()
        self._length = stop

    @property
    def _still(self) -> bool:
        return self._held is None or self.clock.now() >= self._held[0]

    def _settle(self) -> None:
        """What has come to its end meanwhile."""
        if self.state == "Run" and self.clock.now() - self._begun >= self._seconds:
            self._stand(self._from + self._way * self._length)
            self.state = "Idle"
        elif self.state == "Hold" and self._held is not None and self._still:
            self._stand(self._held[1])

    def _stand(self, at: Array) -> None:
        self.at = np.array(at, float)
        self._held = None

    def position(self) -> Array:
        """Machine position now."""
        if self.state == "Run":
            return np.asarray(self._from + self._way * self._along(self.clock.now() - self._begun)[0])
        if self.state == "Hold" and self._held is not None:
            if self._still:
                return self._held[1]
            way, speed, since = self._braking
            t = self.clock.now() - since
            return np.asarray(self._from + self._way * (way + speed * t - 0.5 * self._a * t * t))
        return self.at.copy()

    def put(self, at: Array) -> None:
        """Somebody turns the shafts."""
        self._stand(at)
