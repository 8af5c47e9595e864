"""Stages and lamps that break a promise are found by gonio.testing."""

import threading

import numpy as np
import pytest

from gonio.config.devices import LampConfig, ServoBusConfig
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.testing import Nonconformity, check_light, check_stage, setting


class Fine:
    """A stage without a device: it is wherever it is told to be, and a tenth of the way there while it moves."""

    Config = ServoBusConfig
    at = np.zeros(4)
    late_s = 1e-3  # deadlines below are missed

    def __init__(self):
        self.setting = setting()
        self.axes, self.homed, self._stopped = self.setting.axes, False, threading.Event()

    def connect(self): ...

    def close(self): ...

    def doctor(self):
        yield "ok   fine"

    def home(self):
        self.homed = True

    def pose(self):
        return type(self).at.copy()

    def refuse(self, pose):
        low, high = ([getattr(a, k) for a in self.axes] for k in ("lower", "upper"))
        if not ((pose >= low) & (pose <= high)).all():
            raise SafetyStop("out of limits")

    def move(self, pose, deadline):
        self.refuse(pose)
        if not self._stopped.is_set():
            if deadline < self.late_s:
                raise DeviceFault("light", "late", "wait")
            type(self).at = np.array(pose)
        return self.pose()

    def stop(self):
        self._stopped.set()

    def allow(self):
        self._stopped.clear()

    def park(self):
        self.move(self.setting.park, 60.0)


def test_a_fine_stage_passes():
    check_stage(Fine)


def hang(self):
    threading.Event().wait(5)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"home": lambda self: None}, "homed is not True"),
        ({"pose": lambda self: np.full(4, np.nan)}, "pose: array"),
        ({"pose": lambda self: np.full(4, 9.0)}, "outside its limits"),
        ({"refuse": lambda self, pose: None}, "outside its limits, is not refused"),
        ({"stop": lambda self: None}, "a move was obeyed before `allow`"),
        ({"allow": lambda self: None}, "allow: a move is not obeyed afterwards"),
        ({"late_s": 0.0}, "a move that misses its deadline: nothing is raised"),
        ({"stop": hang}, "stop does not end within"),
        ({"move": lambda self, pose, deadline: self.pose()}, "says it is at"),
    ],
)
def test_a_broken_stage_is_found(change, words, monkeypatch):
    monkeypatch.setattr("gonio.testing.common.PATIENCE_S", 0.5)
    with pytest.raises(Nonconformity) as e:
        check_stage(type("Broken", (Fine,), change))
    assert words in str(e.value)


class Lamp:
    Config = LampConfig
    lit = False

    def connect(self):
        self.off()

    def close(self): ...

    def doctor(self):
        yield "ok   fine"

    def on(self):
        Lamp.lit = True

    def off(self):
        Lamp.lit = False

    def level(self, fraction):
        if not 0 <= fraction <= 1:
            raise ValueError(fraction)


def test_a_fine_lamp_passes():
    check_light(Lamp, lit=lambda: Lamp.lit)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"on": lambda self: None}, "on: the lamp is dark"),
        ({"off": lambda self: None}, "off, from another thread: the lamp is on"),
        ({"level": lambda self, f: None}, "level(-0.1): is taken"),
        ({"connect": lambda self: None}, "connect to a lamp that was left on: it stays on"),
    ],
)
def test_a_broken_lamp_is_found(change, words):
    Lamp.lit = False
    with pytest.raises(Nonconformity) as e:
        check_light(type("Broken", (Lamp,), change), lit=lambda: Lamp.lit)
    assert words in str(e.value)
