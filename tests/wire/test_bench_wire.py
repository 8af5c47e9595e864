"""The study of the wire: the clock of a hurried rig tells the seconds of one that is not."""

from gonio.bench.speed.wire import drive
from gonio.config import Material
from tests.wire.lab import WIRE


def test_seconds_are_a_real_rigs_however_hurried():
    """Nothing is shorter than its plan, and a machine's milliseconds are not multiplied by the clock's scale."""
    sampler = {"proposal": "pss_vndf", "chains": 16}
    material = Material.model_validate(
        {"name": "m", "channels": 3, "truth": "analytic_gloss", "sampler": sampler, "budget": {"measurements": 40}}
    )
    for scale in (1e5, 1e3):
        found = drive(material, WIRE.model_copy(update={"clock_scale": scale}))
        assert found.wall_s >= 0.98 * found.plan_s
        assert found.wall_s <= 1.5 * found.plan_s + 2 * found.machine_s
        assert 0 < found.visiting_s <= found.machine_s
