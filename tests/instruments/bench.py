"""Emulated text instruments and their driver on a pseudo-terminal or a TCP port."""

import numpy as np

from drivers.text.detector import TextDetector
from gonio.config.detectors import PhotodiodeConfig
from gonio.config.instrument import TextSection
from gonio.rig.clock import ScaledClock
from sim.wire.instruments import KINDS
from sim.wire.line import Line, Server
from sim.wire.meter import Meter
from sim.wire.plain import PlainDevice

QUIET = PhotodiodeConfig(shot_noise=0, read_noise=0, dark=0)
FAST = ScaledClock(1e4)


class Bench:
    """`device` at the far end of a line, `detector` at this one; `signal` is what it sees."""

    def __init__(self, folder, instrument, device=None, *, noise=QUIET, exposure=0.1, **section):
        self.signal = np.array([0.1])
        white = section.setdefault("white", 1.0)
        self.meter = Meter(noise, lambda: self.signal, white, 1, FAST, exposure)
        self.device: PlainDevice = device or KINDS[instrument](self.meter)
        self.line = Line(folder / "instrument", self.device)
        self.server = Server([self.line])
        self.section = TextSection(instrument=instrument, port=str(self.line.path), **section)
        self.detector = TextDetector(self.section, noise, exposure, FAST)

    def close(self):
        self.detector.close()
        self.server.close()


def described(answer=r"(?P<value>\S+)", **keys):
    """A description that answers at once and is not waited for."""
    return {"name": "meter", "query": "?", "answer": answer, "timeout_s": 0.05, "reading_s": 0, **keys}


def answering(*answers, **keys):
    """A device that answers ? with each of these in turn, the last of them for ever."""
    left = list(answers)
    return PlainDevice([(r"\?", lambda: left.pop(0) if len(left) > 1 else left[0])], **keys)
