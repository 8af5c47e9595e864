"""An emulated lamp on a text line."""

from typing import Literal

from sim.light import SimLight
from sim.wire.text import TextDevice

Trouble = Literal["burnt", "half", "flickers", "deaf", "stuck"]


class WireLight(TextDevice):
    """lamp: what it shines with. interlock: whether the door is open. trouble: what it does besides what it says.

    burnt: dark; half: half its power; flickers: every other moment; deaf: keeps its level; stuck: on, at full level.
    """

    def __init__(self, lamp: SimLight):
        super().__init__(
            {
                "*IDN?": lambda _: "gonio,lamp,0,1",
                "OUTP": self._switch,
                "OUTP?": lambda _: str(int(lamp.lit)),
                "LEV": self._level,
                "SYST:ERR?": lambda _: '0,"No error"',
            }
        )
        self.lamp, self.interlock = lamp, False
        self.trouble: Trouble | None = None
        self._moments = 0

    def power(self) -> float:
        """What it shines with, relative to full level."""
        told = self.lamp.power()
        match self.trouble:
            case "burnt":
                return 0.0
            case "half":
                return 0.5 * told
            case "flickers":
                self._moments += 1
                return told * (1.0 if self._moments % 2 else 0.4)
            case "stuck":
                return 1.0
        return told

    def open_door(self) -> None:
        self.interlock = True
        self.lamp.off()

    def _switch(self, text: str) -> str:
        if text not in ("0", "1"):
            raise ValueError(text)
        if text == "1" and self.interlock:
            return "ERR 10,interlock open"
        self.lamp.lit = text == "1"
        return text

    def _level(self, text: str) -> str:
        if self.trouble == "deaf":
            return text
        self.lamp.level(float(text))
        return text
