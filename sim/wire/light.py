"""An emulated lamp on a text line."""

from sim.light import SimLight
from sim.wire.text import TextDevice


class WireLight(TextDevice):
    """lamp: what it shines with. interlock: whether the door is open."""

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
        self.lamp.level(float(text))
        return text
