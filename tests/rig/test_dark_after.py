"""Whatever ends a measurement early: the light is off, the motors stand, and the error is the one that was raised."""

import threading

import pytest

from gonio.config.plan import PlanConfig
from tests.rig.test_staged import IDS, WI, WO, make


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(1), MemoryError("no more")])
def test_any_error_puts_the_light_out_and_halts_the_motors(error):
    rig, _ = make()
    seen = []
    with pytest.raises(type(error)) as e:
        for v in rig.visit(WI, WO, IDS):
            seen.append(v)
            rig.announce = lambda number: (_ for _ in ()).throw(error)
    assert e.value is error and len(seen) == 1
    assert not rig.light.lit and rig.stage.halted.is_set()


def test_an_error_stops_the_motion_that_was_ahead_of_it():
    rig, log = make(PlanConfig(tour=False, overlap=True))
    under_way, move = threading.Event(), rig.stage.move

    def slow(pose, deadline):
        if log.count("move") == 1:
            under_way.set()
            assert rig.stage.halted.wait(30)
        return move(pose, deadline)

    def interrupted(number):
        assert under_way.wait(30)
        raise KeyboardInterrupt

    rig.stage.move = slow
    visit = rig.visit(WI, WO, IDS)
    next(visit)
    rig.announce = interrupted
    with pytest.raises(KeyboardInterrupt):
        next(visit)
    assert rig.stage.halted.is_set() and not rig.light.lit and log.count("move") <= 2


def test_a_lamp_that_stays_on_is_told_beside_the_error():
    rig, _ = make()
    rig.announce = lambda number: (_ for _ in ()).throw(KeyboardInterrupt)

    def off():
        raise RuntimeError("relay")

    rig.light.off = off
    with pytest.raises(KeyboardInterrupt) as e:
        list(rig.visit(WI, WO, IDS))
    assert "could not be put off" in e.value.__notes__[0] and "relay" in e.value.__notes__[0]


def test_a_loop_that_is_left_early_keeps_its_light():
    """A run that has enough looks once more at what it saw: the lamp is warm, and may be asked."""
    rig, _ = make()
    for _ in rig.visit(WI, WO, IDS):
        break
    assert rig.light.lit and not rig.stage.halted.is_set()
