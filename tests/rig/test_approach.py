"""Where backlash matters, and what it costs not to see it."""

import numpy as np
import pytest

from gonio.config import load_config
from gonio.config.rig import RigConfig
from gonio.rig.build import envelope_of
from gonio.rig.motion.approach import Approach
from gonio.rig.motion.profile import move_time
from tests.conftest import ROOT

SIM = load_config(ROOT / "configs/rigs/sim.yaml", RigConfig)
ENVELOPE = envelope_of(SIM)
PLAY = np.radians(np.full(4, 0.25))
AXES = {name: k for k, name in enumerate(SIM.axis_names)}


def matters(pose_deg, isotropic):
    found = Approach(ENVELOPE, PLAY, "needed", isotropic)._matters(np.radians(pose_deg))
    return {name for name, k in AXES.items() if found[k]}


@pytest.mark.parametrize(
    ("pose", "free"),
    [
        ((-45, 20, 45, 0), {"turntable"}),  # the mirror direction: the half vector turns, the cosines stand still
        ((-45, 20, 30, 50), {"turntable"}),
        ((-45, 20, 0, 50), {"turntable", "azimuth"}),  # the detector overhead: its azimuth shows nothing
        ((0, 20, 45, 50), {"turntable", "azimuth"}),  # the light overhead: an azimuth turns all alike
    ],
)
def test_what_shows_on_an_isotropic_sample(pose, free):
    assert matters(pose, True) == set(AXES) - free


def test_on_an_anisotropic_sample_the_turntable_shows():
    assert matters((-45, 20, 45, 0), False) == set(AXES)
    assert matters((0, 20, 0, 50), False) == {"light", "detector"}


def test_what_is_left_out_turns_no_pair_by_more_than_half_a_count():
    """2,000 poses: the play of the axes said not to matter, against the half and difference vectors' own change."""
    from gonio.geometry import to_half_diff

    rng = np.random.default_rng(0)
    approach, least = Approach(ENVELOPE, PLAY, "needed", True), ENVELOPE.resolution[0] / 2
    worst = 0.0
    for pose in rng.uniform(np.radians([-80, -170, 5, -170]), np.radians([-5, 170, 80, 170]), (2000, 4)):
        pose[3] = rng.choice([0.0, pose[3]])
        lost = np.where(approach._matters(pose), 0.0, PLAY)
        (wi, wo), (vi, vo) = (ENVELOPE.kinematics.forward(p) for p in (pose, pose + lost))
        (h, _, d, _), (g, _, e, _) = to_half_diff(wi[None], wo[None]), to_half_diff(vi[None], vo[None])
        worst = max(worst, float(abs(h - g)[0]), float(abs(d - e)[0]))
    assert worst <= 3 * least  # of four axes together


def test_from_below_where_it_matters_and_straight_where_not():
    seconds = lambda delta: move_time(delta, np.full(4, 1.0), np.full(4, 2.0))
    approach = Approach(ENVELOPE, PLAY, "needed", True)
    start, end = (ENVELOPE.snap(np.radians(a)) for a in ((-30, 60, 60, 20), (-45, 20, 45, 0)))
    way = approach.legs(start, end, seconds)
    assert len(way) == 2 and (way[0] <= end + 1e-9).all()
    below = np.radians(0.25) < end - way[0]
    assert below.tolist() == [True, False, True, True]
    assert len(approach.legs(way[0], end, seconds)) == 1
