"""A rule that is met in the middle of a block ends the run there: late blocks are as large as all before them."""

from gonio.acquire import acquire
from gonio.brdf.models.lambert import Lambert
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.mcmc import make_sampler
from gonio.run.open_rig import open_rig
from gonio.run.record.store import Store


def test_a_rule_is_asked_inside_a_block(tmp_path):
    material = Material.model_validate({"name": "x", "budget": {"measurements": 400}})
    rig = open_rig(load_config(find_config("sim", "rigs"), RigConfig), Lambert([0.3, 0.2, 0.1]), 1, isotropic=True)
    sampler = make_sampler(material, rig.reachable, None, (400,))
    store = Store.create(tmp_path / "run", "", {})
    try:
        reason = acquire(
            sampler, rig, store, material, good_enough=lambda p: "enough" if p.measured >= 70 else None
        )  # blocks of 24, 24, 48, 96, 208
        assert reason == "enough" and len(store.measured().id) == 70
    finally:
        store.close()
        rig.close()
