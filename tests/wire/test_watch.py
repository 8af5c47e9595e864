"""A rig that no longer sees light does not measure on: found by a look, named, and what may be wrong is made again."""

import numpy as np
import pytest

from gonio.brdf import Ggx, Lambert, Mixture
from gonio.config import Material
from gonio.rig.errors import DeviceFault
from gonio.rig.signal.watch import LostSight
from gonio.run.open_rig import open_rig
from gonio.run.record.samples import load_samples
from gonio.run.record.store import Store
from gonio.run.start import resume, start
from tests.test_kill import contents
from tests.wire.test_faults import WIRE, opened, pairs
from tests.wire.test_survival import same

TRUTH = Mixture([Lambert([0.3, 0.2, 0.1]), Ggx(0.2, None, [0.05, 0.05, 0.05])])
N, SIXTH = 48, 6


def lamp(trouble):
    return lambda e: setattr(e.light, "trouble", trouble)


TROUBLES = {
    "interlock": (lambda e: e.light.open_door(), "light: interlock open; close the door"),
    "burnt out": (lamp("burnt"), "light: what it sends no longer reaches the detector"),
    "half power": (lamp("half"), "light: what it sends has changed: (4|5)\\d%"),
    "flickers": (lamp("flickers"), "light: what it sends (flickers|has changed)"),
    "ignores its level": (lamp("deaf"), "light: stays on when it is told to go dark"),
    "stays on": (lamp("stuck"), "light: stays on when it is told to go dark"),
    "cap": (lambda e: setattr(e.photodiode, "capped", True), "or a cap on the detector"),
    "room light": (
        lambda e: setattr(e.photodiode, "ambient", 0.05),
        "detector: its dark has changed|light: what it sends",
    ),
    "frozen": (lambda e: setattr(e.photodiode, "frozen", True), "detector: gave the same reading 4 times in a row"),
}


def undo(e):
    e.light.trouble, e.light.interlock = None, False
    e.photodiode.capped, e.photodiode.frozen, e.photodiode.ambient = False, False, 0.0


def made(folder, monkeypatch, look_every=16):
    monkeypatch.setattr("gonio.run.prepare.find_truth", lambda *_: (TRUTH, "gloss"))
    monkeypatch.setattr("gonio.run.start.find_truth", lambda *_: (TRUTH, "gloss"))
    material = Material.model_validate(
        {
            "name": "m",
            "channels": 3,
            "sampler": {"proposal": "pss_vndf", "chains": 16},
            "budget": {"measurements": N},
            "plan": {"look_every": look_every},
        }
    )
    run = start(material, WIRE, folder)
    return run, open_rig(WIRE, TRUTH, material.seed, plan=material.plan, isotropic=True)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The run that nothing happened to."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    with pytest.MonkeyPatch.context() as patch:
        run, rig = made(folder, patch)
        run(rig=rig)
        run.close()
        assert rig.watch.looks >= N // 16
        rig.close()
    return contents(folder)


@pytest.mark.parametrize("name", TROUBLES)
def test_what_happens_to_the_light_is_found_and_made_good(tmp_path, monkeypatch, whole, name):
    cause, words = TROUBLES[name]
    run, rig = made(tmp_path / "run", monkeypatch)
    happened = []

    def watch(progress):
        if progress.measured == SIXTH and not happened:
            happened.append(True)
            cause(rig.emulators)

    with pytest.raises(LostSight, match=words) as e:
        run(watch=watch, rig=rig)
    run.close()
    assert e.value.exit_code == 3 and "made again" in str(e.value) and not rig.emulators.light.lamp.lit
    rig.close()
    with Store.open(tmp_path / "run", write=False) as store:
        kept, apart = store.measured(), store.suspects()
        assert set(apart) == set(e.value.suspect) and not set(apart) & set(kept.id.tolist())
        assert len(load_samples(store)) == len(kept.id)
        assert len(apart) + len(kept.id) >= SIXTH
    run = resume(tmp_path / "run")  # on a rig that is well again
    run()
    run.close()
    assert same(whole, contents(tmp_path / "run"))
    with Store.open(tmp_path / "run", write=False) as store:
        assert set(store.suspects()) == set(apart), "what was suspect stays on record"


def test_without_looks_it_would_go_unnoticed(tmp_path, monkeypatch):
    """Negative control."""
    run, rig = made(tmp_path / "run", monkeypatch, look_every=0)
    run(watch=lambda p: p.measured == SIXTH and lamp("half")(rig.emulators), rig=rig)
    run.close()
    rig.close()


def test_a_visit_that_ends_with_a_look_does_not_end_well():
    rig = opened()
    try:
        with pytest.raises(DeviceFault, match="no longer reaches"):
            for k, _ in enumerate(rig.visit(*pairs(40))):
                if k == SIXTH:
                    lamp("burnt")(rig.emulators)
    finally:
        rig.close()


def test_a_healthy_rig_never_trips():
    """Its noise, a drift of 1 % in a second of its hurried clock, a dark sample among bright ones."""
    light = WIRE.light.model_copy(update={"drift_per_h": 0.01})
    rig = opened(light=light)
    try:
        rig.watch.every = 8
        assert len(list(rig.visit(*pairs(400)))) > 300 and rig.watch.looks > 30
        assert np.isfinite(rig.watch._bright[0].light).all()
    finally:
        rig.close()
