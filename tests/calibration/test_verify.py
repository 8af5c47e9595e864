"""What must hold of a calibrated rig, holds; what does not is seen."""

import numpy as np
import pytest

from calibration.radiometry import Certificate
from calibration.verify import Check, verdict, verify
from gonio.brdf.models.lambert import Lambert
from gonio.config import load_config
from gonio.config.find import find_config
from gonio.config.rig import LightConfig, RigConfig
from gonio.geometry import from_angles
from gonio.run.open_rig import open_rig

SIM = load_config(find_config("sim", "rigs"), RigConfig)


class Odd(Lambert):
    """A diffuser of albedo 0.9, wrong in one way."""

    def __init__(self, way):
        super().__init__([0.9] * 3)
        self.way = way

    def eval(self, wi, wo):
        f = super().eval(wi, wo)
        if self.way == "one-way":
            return f * (1 + 0.1 * wi[:, 2:])
        if self.way == "brushed":
            return f * (1 + 0.05 * np.sign(wi[:, :1]))
        return f * 1.2 if self.way == "bright" else f


def checks(lies, config=SIM, certificate=None, wait=None):
    rig = open_rig(config, lies, 0)
    try:
        found = verify(rig, certificate, (lambda: rig.clock.sleep(3600.0)) if wait else None, lambda text: None)
        assert not rig.light.lit
    finally:
        rig.close()
    return {c.name: c for c in found}


def angles(f):
    theta = np.radians([10.0, 20, 30, 40, 50, 60])
    return Certificate(from_angles(theta, np.zeros(6)), from_angles(theta * 0.5, np.full(6, 2.5)), f, np.full(6, 0.001))


def test_a_good_rig_passes():
    found = checks(Lambert([0.9] * 3), certificate=angles(np.full((6, 3), 0.9 / np.pi)), wait=True)
    assert all(c.passed for c in found.values()) and len(found) == 5
    assert verdict(list(found.values())) == "all 5 checks made hold"


@pytest.mark.parametrize(("way", "fails"), [("one-way", "reciprocity"), ("brushed", "isotropy"), ("bright", "energy")])
def test_each_fault_fails_its_check(way, fails):
    found = checks(Odd(way))
    assert found[fails].passed is False
    text = verdict(list(found.values()))
    assert text.startswith("not to be trusted: ") and fails in text
    assert found["repeat"].passed is None and "not made" in found["repeat"].text


def test_a_wrong_gain_fails_at_the_standard():
    found = checks(Lambert([0.9] * 3), certificate=angles(np.full((6, 3), 0.95 * 0.9 / np.pi)))
    assert found["standard"].passed is False and found["standard"].value == pytest.approx(0.053, abs=0.005)


def test_a_lamp_that_fades_fails_the_repeat():
    found = checks(Lambert([0.9] * 3), SIM.model_copy(update={"light": LightConfig(drift_per_h=-0.05)}), wait=True)
    assert found["repeat"].passed is False and found["repeat"].value == pytest.approx(0.05, abs=0.01)


def test_noise_is_no_fault():
    assert Check("x", 0.015, 0.006, 0.01).passed and not Check("x", 0.017, 0.006, 0.01).passed


def test_who_cannot_tell_says_so():
    unsure = Check("x", 0.11, 0.12, 0.01)
    assert unsure.passed is None and "cannot tell" in unsure.text
    assert Check("x", 0.2, 0.12, 0.01).passed is False
    assert verdict([unsure, Check("y", np.nan, np.nan, 0.01, "out of reach")]).startswith("nothing could be checked")
