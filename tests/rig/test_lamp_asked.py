"""A rig that has never seen anything bright still asks its lamp how it is."""

import numpy as np
import pytest

from gonio.rig.errors import DeviceFault
from gonio.rig.signal.watch import LostSight, Watch


class Lamp:
    def __init__(self):
        self.asked, self.dead = 0, False

    def confirm(self):
        self.asked += 1
        if self.dead:
            raise DeviceFault("light", "says it does not burn", "check its supply, then `gonio resume`")


def test_without_anything_bright_the_lamp_is_asked():
    lamp = Lamp()
    watch = Watch(None, lamp, None, 0.1, 20, lambda k: None)
    watch.since = list(range(19))
    assert not watch.due
    watch.since.append(19)
    assert watch.due and watch.nearest(lambda poses: np.zeros(len(poses))) is None
    watch.ask_only()
    assert lamp.asked == 1 and not watch.due and watch.looks == 1
    lamp.dead, watch.since = True, list(range(20, 40))
    with pytest.raises(LostSight) as e:
        watch.ask_only()
    assert e.value.suspect == list(range(20, 40)) and "20 measurements are made again" in str(e.value)
