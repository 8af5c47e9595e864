"""The lamp: on, off, level, warm-up, interlock.

*IDN?   -> *IDN? maker,model,serial,firmware
OUTP 0|1 -> OUTP 0|1          ERR 10,.. while the interlock is open
OUTP?   -> OUTP? 0|1
LEV x   -> LEV x              0 ... 1
"""

import time

from drivers.gone import PortGone
from drivers.text_line import Refused, TextLine
from gonio.rig.clock import Clock
from gonio.rig.errors import DeviceFault

INTERLOCK = 10  # the error while it is open
BELIEVED_S = 1.0  # how long the lamp is taken to be as it was told, before it is asked again


class SerialLight:
    """Implements `gonio.rig.devices.Light`. warm_up_s passes on the rig's clock. Call `connect` first."""

    def __init__(self, line: TextLine, clock: Clock, warm_up_s: float = 0.0):
        self.line, self.clock, self.warm_up_s = line, clock, warm_up_s
        self._lit: bool | None = None
        self._level: float | None = None
        self._asked, self._restarts = 0.0, 0

    def connect(self) -> None:
        """It is off afterwards. Raises DeviceFault."""
        try:
            self.line.open()
        except PortGone as e:
            raise self.line.gone(e) from None
        self.line.ask("*IDN?")
        self.off()

    def close(self) -> None:
        self.line.close()

    def on(self) -> None:
        """Lit when this returns, `warm_up_s` later if it was dark."""
        if self._lit and time.monotonic() - self._asked < BELIEVED_S and self.line.restarts == self._restarts:
            return
        was = self._lit and self._ask("OUTP?") == "1"
        if not was:
            if self._ask("OUTP 1") != "1":
                raise DeviceFault("light", "does not switch on", "check its supply")
            if self._level is not None:  # it may have forgotten
                self._set_level(self._level)
            self.clock.sleep(self.warm_up_s)
        self._lit, self._asked, self._restarts = True, time.monotonic(), self.line.restarts

    def off(self) -> None:
        """Raises DeviceFault where it cannot be reached."""
        self._lit = None
        if self._ask("OUTP 0") != "0":
            raise DeviceFault("light", "does not switch off", "cut its power")
        self._lit = False

    def confirm(self) -> None:
        """Raises DeviceFault where it does not say that it is on; with its reason, where it has one."""
        if self._ask("OUTP?") != "1":
            self._ask("OUTP 1")  # an open interlock is said now
            raise DeviceFault("light", "went out by itself", "check its supply, then `gonio resume`")

    def level(self, fraction: float) -> None:
        if not 0 <= fraction <= 1:
            raise ValueError(f"level must lie in [0, 1], not {fraction}")
        if fraction == self._level and self.line.restarts == self._restarts:
            return
        self._set_level(fraction)

    def _set_level(self, fraction: float) -> None:
        self._level = None
        text = f"{fraction:.4f}"
        if self._ask(f"LEV {text}") != text:
            raise DeviceFault("light", f"does not take the level {text}", "check its firmware")
        self._level = fraction

    def _ask(self, command: str) -> str:
        try:
            return self.line.ask(command)
        except Refused as e:
            self._lit = None
            if e.code == INTERLOCK:
                raise DeviceFault("light", e.cause, "close the door or cover, then `gonio resume`") from None
            raise
