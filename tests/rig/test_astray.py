"""A stage that is not where it was sent, or does not know where it is, is not driven on."""

import numpy as np
import pytest

from gonio.rig.errors import DeviceFault
from tests.rig.test_staged import IDS, WI, WO, make


def off_by(degrees):
    """A stage whose first axis comes to rest so far from where it was sent."""
    rig, _ = make()

    def move(pose, deadline):
        rig.stage.log.append("move")
        rig.stage.at = np.array([pose[0] + np.radians(degrees), *pose[1:]])
        return rig.stage.at

    rig.stage.move = move
    return rig


@pytest.mark.parametrize(
    ("degrees", "words"),
    [
        (57.0, "stage, light: is 57.0 degrees off the pose asked for; check its encoder"),
        (-5.1, "stage, light: is 5.1 degrees off the pose asked for; check its encoder"),
        (np.nan, "stage, light: shows nan in place of an angle; check its encoder"),
        (np.inf, "stage, light: shows inf in place of an angle; check its encoder"),
    ],
)
def test_a_stage_that_went_astray_is_not_driven_on(degrees, words):
    rig, seen = off_by(degrees), []
    with pytest.raises(DeviceFault) as e:
        for v in rig.visit(WI, WO, IDS):
            seen.append(v)
    assert words in str(e.value) and "\n" not in str(e.value)
    assert seen == [] and rig.stage.log.count("move") == 1 and not rig.light.lit


def test_one_that_stops_short_is_measured_where_it_is():
    rig = off_by(4.9)
    assert len(list(rig.visit(WI[:1], WO[:1], IDS[:1]))) == 1


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (np.full(4, np.nan), "stage, light: shows nan in place of an angle"),
        (np.zeros(3), "stage: shows no pose of 4 axes"),
        (None, "stage: shows no pose of 4 axes: 'None'"),
    ],
)
def test_without_a_pose_nothing_moves(pose, words):
    rig, log = make()
    rig.stage.pose = lambda: pose
    with pytest.raises(DeviceFault, match=words):
        rig._go(np.zeros(4))
    assert "move" not in log


def test_a_pose_that_is_lost_before_a_visit_puts_the_light_out():
    rig, log = make()
    rig.stage.pose = lambda: np.full(4, np.nan)
    with pytest.raises(DeviceFault, match="in place of an angle"):
        list(rig.visit(WI, WO, IDS))
    assert "move" not in log and not rig.light.lit


def test_where_a_stop_left_it_is_no_fault():
    rig = off_by(57.0)
    astray = rig.stage.move

    def stopped(pose, deadline):
        rig.stop()
        return astray(pose, deadline)

    rig.stage.move = stopped
    assert list(rig.visit(WI, WO, IDS)) == []
