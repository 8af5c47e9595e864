"""One emulated Dynamixel X servo: control table, torque lock, limits, profiles, watchdog, and what may break.

The rig's clock drives the motion and may run fast; the bus watchdog guards a host that lives on the machine's clock.
Motion starts from rest at the moment a goal is written: a goal changed on the way brakes for nothing.
"""

import math
import time
from dataclasses import dataclass

from gonio.rig.clock import Clock

COUNT_DEG = 360 / 4096
SIZES = {
    0: 2, 6: 1, 7: 1, 8: 1, 9: 1, 10: 1, 11: 1, 20: 4, 31: 1, 32: 2, 34: 2, 36: 2, 38: 2, 44: 4, 48: 4, 52: 4, 63: 1,
    64: 1, 65: 1, 68: 1, 70: 1, 76: 2, 78: 2, 80: 2, 82: 2, 84: 2, 98: 1, 104: 4, 108: 4, 112: 4, 116: 4, 122: 1,
    123: 1, 126: 2, 128: 4, 132: 4, 136: 4, 140: 4, 144: 2, 146: 1,
}  # fmt: skip
READ_ONLY = {0, 6, 70, 122, 123, 126, 128, 132, 136, 140, 144, 146}
EEPROM = {0: 1020, 6: 48, 8: 1, 9: 250, 10: 0, 11: 3, 31: 80, 32: 160, 34: 95, 36: 885, 38: 1193, 44: 200,
          48: 4095, 52: 0, 63: 0b110100}  # fmt: skip
RAM = {68: 2, 84: 800, 144: 120, 146: 35}
ACCESS, LIMIT, LENGTH = 7, 6, 5


@dataclass
class Troubles:
    """What is wrong with a servo: sticks; stops `droop` counts short; claims to be at its goal; sleeps on reboot."""

    stuck: bool = False
    droop: int = 0
    lies: bool = False


class Servo:
    """`position(now)` is where the motor is, in counts; `true_angle_deg` where the arm behind the backlash is."""

    def __init__(self, number: int, clock: Clock, position: float = 2048, model: int = 1020, backlash_deg: float = 0.0):
        self.id, self.clock = number, clock
        self.table = bytearray(256)
        self.troubles = Troubles()
        self.backlash, self._lag = backlash_deg / COUNT_DEG, 0.0
        self._from = self._to = float(position)
        self._begun = self._until = clock.now()
        self._v = self._a = 1.0
        self._fed = time.monotonic()
        for address, value in {**EEPROM, 0: model, 7: number}.items():
            self.put(address, value)
        self.power_on()

    # ---- registers -------------------------------------------------------------------------------------------------

    def get(self, address: int, signed: bool = False) -> int:
        return int.from_bytes(self.table[address : address + SIZES[address]], "little", signed=signed)

    def put(self, address: int, value: int) -> None:
        size = SIZES[address]
        self.table[address : address + size] = (value & (1 << 8 * size) - 1).to_bytes(size, "little")

    def power_on(self) -> None:
        """RAM as it is after a reboot or a dip of the supply; the shaft stays where it is."""
        here = self.position(self.clock.now())
        self.table[64:147] = bytes(83)
        for address, value in RAM.items():
            self.put(address, value)
        self.hold(here)

    def read(self, address: int, size: int) -> bytes:
        if address + size > 122:
            self.refresh()
        return bytes(self.table[address : address + size])

    def write(self, address: int, data: bytes) -> int:
        """0, or the error that the status packet tells. A block is written register by register."""
        at = address
        while at < address + len(data):
            size = SIZES.get(at)
            if size is None:
                return ACCESS
            chunk = data[at - address : at - address + size]
            if len(chunk) < size:
                return LENGTH
            if error := self._write_one(at, int.from_bytes(chunk, "little", signed=at in (20, 116))):
                return error
            at += size
        return 0

    def _write_one(self, address: int, value: int) -> int:
        if address in READ_ONLY or (address < 64 and self.get(64)):
            return ACCESS
        if address == 116:
            if self.get(98) == 255:
                return ACCESS
            if self.get(11) == 3 and not self.get(52) <= value <= self.get(48):
                return LIMIT
            self.put(116, value)
            self.go(value)
            return 0
        if address in (48, 52) and not 0 <= value <= 4095:
            return LIMIT
        if address == 98 and value > 127:
            return LIMIT
        if address == 64 and value:
            if self.get(70):
                return ACCESS  # shut down: only a reboot helps
            self.put(64, 1)
            self.hold(self.position(self.clock.now()))
            return 0
        self.put(address, value)
        if address == 64:
            self.hold(self.position(self.clock.now()))
        return 0

    def refresh(self) -> None:
        """Present values of now."""
        now = self.clock.now()
        moving = now < self._until
        shown = self.get(116, True) if self.troubles.lies else round(self.position(now))
        self.put(132, shown)
        self.table[122:124] = b"\1\2" if moving else b"\0\1"

    @property
    def alert(self) -> int:
        return 0x80 if self.table[70] else 0

    # ---- motion ----------------------------------------------------------------------------------------------------

    def go(self, goal: float) -> None:
        """Start towards a goal; with the torque off nothing moves."""
        now = self.clock.now()
        here = self.position(now)
        self._from, self._begun = here, now
        way = goal - here
        if not self.get(64) or self.troubles.stuck:
            way = 0.0
        elif self.troubles.droop:
            way = math.copysign(max(abs(way) - self.troubles.droop, 0.0), way)
        self._to = here + way
        if way:
            self._lag = 0.0 if way > 0 else self.backlash
        top = self.get(44) * 1.374 / COUNT_DEG
        v, a = self.get(112), self.get(108)
        if self.get(10) & 4 and v:  # time-based: ms of the whole move and of each ramp
            ramp = min(max(a, 1), v / 2) / 1000
            self._v = max(abs(way), 1e-9) / (v / 1000 - ramp)
            self._a = self._v / ramp
            if self._v > top:
                self._v = top
        else:
            self._v = min(v * 1.374 / COUNT_DEG or top, top)
            self._a = (a or 1000) * 21.46 / COUNT_DEG
        self._until = now + self._seconds()

    def hold(self, here: float) -> None:
        """Stand still here; in position mode the goal is the present position then."""
        self._stand(here)
        self.put(116, round(here))

    def _stand(self, here: float) -> None:
        self._from = self._to = here
        self._begun = self._until = self.clock.now()

    def _seconds(self) -> float:
        d = abs(self._to - self._from)
        ramp = self._v * self._v / self._a
        return 2 * math.sqrt(d / self._a) if d < ramp else d / self._v + self._v / self._a

    def position(self, now: float) -> float:
        if now >= self._until:
            return self._to
        d, total, t = abs(self._to - self._from), self._until - self._begun, now - self._begun
        t_ramp = min(self._v / self._a, total / 2)
        if t < t_ramp:
            s = 0.5 * self._a * t * t
        elif total - t < t_ramp:
            s = d - 0.5 * self._a * (total - t) ** 2
        else:
            s = 0.5 * self._a * t_ramp**2 + (t - t_ramp) * self._v
        return self._from + math.copysign(s, self._to - self._from)

    def true_angle_deg(self) -> float:
        return (self.position(self.clock.now()) + self._lag - 2048) * COUNT_DEG

    # ---- what may break --------------------------------------------------------------------------------------------

    def feed(self) -> None:
        """Any packet on the bus: the watchdog starts anew, or is found to have tripped."""
        now, waits = time.monotonic(), self.table[98] * 0.02
        silent = now - self._fed
        self._fed = now
        if self.table[98] and self.table[98] != 255 and silent > waits:
            here = self.position(self.clock.now() - (silent - waits))
            self.table[98] = 255
            self._stand(here)

    def fail(self, bit: int) -> None:
        """Overload (5), overheat (2), voltage (0) …: register 70; what the shutdown mask names takes the torque."""
        here = self.position(self.clock.now())
        self.put(70, self.get(70) | 1 << bit)
        if self.get(63) >> bit & 1:
            self.put(64, 0)
            self._stand(here)
