"""Does a driver keep what `gonio.rig.driver` and `gonio.rig.devices` ask for? For the tests of whoever writes one.

    from gonio.testing import check_detector
    def test_conformance():
        check_detector(lambda: MyDetector(config, setting), fault=unplug, mend=plug)

Each check is handed a function that makes the driver, not connected, any number of times on the same device. It raises
Nonconformity, an AssertionError of one line. fault() breaks the device so that it cannot be used (a plug pulled),
mend() undoes that; without them that part is left out.
"""

from gonio.testing.common import Nonconformity
from gonio.testing.detector import check_detector
from gonio.testing.light import check_light
from gonio.testing.settings import setting
from gonio.testing.stage import check_stage

__all__ = ["Nonconformity", "check_detector", "check_light", "check_stage", "setting"]
