"""A run is compared with, and gone on with, the file it was begun with: not whatever has that name today."""

import pytest

from gonio.brdf.models.lambert import Lambert
from gonio.config import ConfigError, Material, load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.export.bsdf import write_bsdf
from gonio.run.start import resume, start
from gonio.run.truth import own_truth


@pytest.fixture
def run(tmp_path, monkeypatch):
    for place, albedo in (("then", 0.2), ("now", 0.7)):
        (tmp_path / place).mkdir()
        write_bsdf(Lambert([albedo] * 3), tmp_path / place / "thing.bsdf")
    monkeypatch.setenv("GONIO_MATERIALS", str(tmp_path / "then"))
    material = Material.model_validate({"name": "thing", "truth": "thing", "budget": {"measurements": 60}})
    start(material, load_config(find_config("ideal", "rigs"), RigConfig), tmp_path / "run").close()
    return tmp_path / "run"


def test_the_same_file_elsewhere_is_the_same_truth(run, tmp_path, monkeypatch):
    (tmp_path / "then").rename(tmp_path / "moved")
    monkeypatch.setenv("GONIO_MATERIALS", str(tmp_path / "moved"))
    assert own_truth(run).path.parent.name == "moved"
    resume(run).close()


@pytest.mark.parametrize("use", [own_truth, resume])
def test_another_file_of_the_same_name_is_refused(run, tmp_path, monkeypatch, use):
    monkeypatch.setenv("GONIO_MATERIALS", str(tmp_path / "now"))
    with pytest.raises(ConfigError, match=r"thing was another file when it was measured.*GONIO_MATERIALS"):
        use(run)
