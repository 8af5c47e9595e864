"""Drivers of others: what they raise without meaning to, and readings that are none, are faults in one line."""

import numpy as np
import pytest

from gonio.config.plan import PlanConfig
from gonio.rig.build import envelope_of, radiometry_of
from gonio.rig.clock import RealClock
from gonio.rig.devices import Reading
from gonio.rig.errors import DeviceFault
from gonio.rig.staged import StagedRig
from tests.rig.test_staged import IDS, SIM, WI, WO, Detector, Light, Log, Stage, make


def raising(error):
    def fails(*arguments):
        raise error

    return fails


def fault_of(rig):
    with pytest.raises(DeviceFault) as e:
        list(rig.visit(WI, WO, IDS))
    assert "\n" not in str(e.value) and not rig.light.lit
    return e.value


@pytest.mark.parametrize(
    ("device", "method", "error", "words"),
    [
        ("detector", "read", ValueError("could not\nconvert 'x'"), "detector: ValueError (could not convert 'x')"),
        ("detector", "expect", TypeError(), "detector: TypeError in `expect` of its driver"),
        ("stage", "move", KeyError("axis"), "stage: KeyError ('axis') in `move` of its driver"),
        ("stage", "pose", IndexError("5"), "stage: IndexError (5) in `pose` of its driver"),
        ("light", "on", TypeError("no port"), "light: TypeError (no port) in `on` of its driver"),
        ("light", "level", ValueError("0"), "light: ValueError (0) in `level` of its driver"),
    ],
)
def test_what_a_driver_lets_slip_names_device_and_driver(device, method, error, words):
    rig, _ = make()
    rig.surrogate = lambda wi, wo: np.full((len(wi), 3), 0.25)
    owner = getattr(rig, device)
    setattr(owner, method, raising(error))
    fault = fault_of(rig)
    assert str(fault).startswith(words) and fault.__cause__ is error
    assert f"tests.rig.test_staged.{type(owner).__name__};" in str(fault)


def test_a_light_that_cannot_be_put_off_is_named():
    rig, _ = make()
    rig.light.off = raising(ValueError("relay"))
    with pytest.raises(DeviceFault, match=r"light: ValueError \(relay\) in `off` of its driver"):
        rig.park()


def test_what_a_driver_means_to_say_is_passed_on():
    rig, _ = make()
    said = DeviceFault("meter", "no reply", "check its cable")
    rig.detector.read = raising(said)
    assert fault_of(rig) is said


def test_an_error_of_a_simulated_sample_is_its_own():
    log, envelope = Log(), envelope_of(SIM)
    devices = Stage(log, envelope), Detector(log), Light(log)
    plan = PlanConfig(tour=False)
    rig = StagedRig(SIM, envelope, *devices, radiometry_of(SIM, 3), RealClock(), plan, False, simulated=True)
    rig.detector.read = raising(ZeroDivisionError("f"))
    with pytest.raises(ZeroDivisionError):
        list(rig.visit(WI, WO, IDS))
    assert not rig.light.lit


GOOD, SIGMA, RAW = np.full(3, 0.5), np.full(3, 0.01), {"exposure_s": 0.1}


@pytest.mark.parametrize(
    ("reading", "words"),
    [
        (Reading(GOOD, np.array([0.01, np.nan, 0.01]), False, RAW), "gave no reading: a sigma that is not finite"),
        (Reading(GOOD, np.array([0.01, -0.1, 0.01]), False, RAW), "gave no reading: a sigma of -0.1"),
        (Reading(GOOD, np.array([0.01, -0.1, 0.01]), True, RAW), "gave no reading: a sigma of -0.1"),
        (Reading(GOOD * np.nan, SIGMA * np.nan, False, RAW), "a value that is not finite, and not saturated"),
        (Reading(GOOD[:2], SIGMA, False, RAW), "its value has the shape (2,) in place of (3,)"),
        (Reading(GOOD[None], SIGMA, False, RAW), "its value has the shape (1, 3) in place of (3,)"),
        (Reading(GOOD, SIGMA[:1], False, RAW), "its sigma has the shape (1,) in place of (3,)"),
        (Reading([0.5, 0.5, 0.5], SIGMA, False, RAW), "its value is no array of numbers"),
        (Reading(GOOD, SIGMA, False, {}), "without raw['exposure_s']"),
        (0.5, "float in place of a Reading"),
    ],
)
def test_what_is_no_reading_is_refused(reading, words):
    rig, _ = make()
    good = rig.detector.read
    rig.detector.read = lambda exposure: reading if "move" in rig.detector.log else good(exposure)
    said = str(fault_of(rig))
    assert said.startswith("detector: ") and words in said and "tests.rig.test_staged.Detector" in said


def test_a_saturated_reading_need_not_know_its_value():
    rig, _ = make()
    good, lost = rig.detector.read, Reading(GOOD * np.nan, SIGMA * np.nan, True, RAW)
    rig.detector.read = lambda exposure: lost if "move" in rig.detector.log else good(exposure)
    assert all(v.saturated.all() for v in rig.visit(WI, WO, IDS))
