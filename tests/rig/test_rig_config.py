"""What the rigs' YAML files say, and what is refused."""

import pytest

from gonio.config import ConfigError, load_config
from gonio.config.loader import parse_config
from gonio.config.rig import RigConfig
from gonio.rig.build import axes_of, envelope_of
from gonio.run.open_rig import open_rig
from tests.conftest import ROOT

TEXT = (ROOT / "configs/rigs/sim.yaml").read_text()


@pytest.mark.parametrize("name", ["ideal", "sim", "wire", "camera", "bench"])
def test_those_that_ship_load(name):
    config = load_config(ROOT / f"configs/rigs/{name}.yaml", RigConfig)
    assert config.name == name and len(axes_of(config)) == 4 and envelope_of(config)


def test_the_yardstick():
    """The defaults that all later numbers are measured with."""
    sim, ideal = (load_config(ROOT / f"configs/rigs/{n}.yaml", RigConfig) for n in ("sim", "ideal"))
    for config in (sim, ideal):
        for axis in config.axes.values():
            assert (axis.velocity_deg_s, axis.acceleration_deg_s2) == (60, 120)
        assert (config.settle_s, config.exposure_s) == (0.10, 0.020)
        assert config.acceptance.light_half_angle_deg == config.acceptance.detector_half_angle_deg == 0
    p = sim.photodiode
    assert (p.shot_noise, p.read_noise, p.bits, p.ranges, p.range_factor) == (0.005, 1e-4, 16, 3, 30)
    assert sim.stay_out_deg == 8 and ideal.stay_out_deg == 0
    assert {a.counts_per_turn for a in sim.axes.values()} == {4096} and not any(
        a.counts_per_turn for a in ideal.axes.values()
    )


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("settle_s:", "settle_ms:", "settle_ms: unknown key; did you mean settle_s"),
        ("velocity_deg_s: 60", "velocity_deg_s: -60", "velocity_deg_s"),
        ("lower_deg: -88", "lower_deg: 88", "upper_deg"),
        ("lower_deg: -88", "lower_deg: -91", "into the table"),
        ("  azimuth:", "  azimut:", "a gantry has light, turntable, detector, azimuth"),
        ("park_deg: {light: -45", "park_deg: {light: -95", "park_deg.light"),
        ("kind: gantry", "kind: robot", "kinematics"),
        ("exposure_s: 0.020", "exposure_s: .nan", "exposure_s"),
        ("depth: devices", "depth: real", "needs a stage"),
    ],
)
def test_mistakes_are_named(old, new, message):
    assert old in TEXT
    with pytest.raises(ConfigError) as e:
        parse_config(TEXT.replace(old, new, 1), RigConfig)
    assert message in str(e.value) and "\n" not in str(e.value)


def test_a_real_rig_refuses_a_truth():
    config = load_config(ROOT / "configs/rigs/bench.yaml", RigConfig)
    with pytest.raises(ConfigError, match="truth: rig bench is real"):
        open_rig(config, object(), 0)
