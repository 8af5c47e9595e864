"""The studies in small: what they print is what they measured."""

import json

import numpy as np
import pytest

from gonio.bench.accuracy import picture_driven, skips
from gonio.bench.accuracy.peers import Config as PeersConfig
from gonio.bench.accuracy.peers import cells, run
from gonio.bench.runner import STUDIES, run_study
from gonio.bench.speed import growth, quick
from gonio.config import ConfigError
from gonio.config.find import SHIPPED


@pytest.mark.slow
def test_peers_on_an_ideal_rig(tmp_path):
    config = PeersConfig(
        study="accuracy", materials=("ggx:0.3",), ways=("ours", "sobol list"), measurements=(30, 60), straight=(60,),
        rig="ideal", workers=1,
    )  # fmt: skip
    said: list[str] = []
    run(config, tmp_path, said.append)
    table = "\n".join(said)
    assert "energy error, gonio's motion for everybody" in table and "straight travel" in table
    assert (tmp_path / "error.png").stat().st_size > 10_000
    parquet = pytest.importorskip("pyarrow.parquet", reason="needs the extra `study`")
    rows = parquet.read_table(tmp_path / "results.parquet")
    assert rows.num_rows == 6 and "config" in json.loads(rows.schema.metadata[b"gonio"])
    again: list[str] = []
    run(config, tmp_path, again.append)  # all of it from what was kept
    assert again == said


def test_a_way_is_asked_for_no_more_than_it_can():
    config = PeersConfig(
        study="accuracy",
        materials=("a",),
        ways=("nielsen pca",),
        measurements=(20, 100, 1000),
        most={"nielsen pca": 100},
    )
    assert {c["n"] for c in cells(config)} == {20, 100}
    with pytest.raises(ConfigError, match="ways: guesswork is not one of ours"):
        run(config.model_copy(update={"ways": ("guesswork",)}), SHIPPED, print)


@pytest.mark.slow
def test_skips(tmp_path):
    rows = []
    for skip in (skips.DEFAULT, "proposals outside the support", "tour"):
        cell = {"skip": skip, "material": "ggx:0.3", "seed": 1, "n": 40, "goal": 0.01, "rig": "sim"}
        rows += [cell | r for r in skips.cell(cell)]
    by = {r["skip"]: r for r in rows}
    assert by["tour"]["rig_s"] > 1.1 * by[skips.DEFAULT]["rig_s"]
    assert by["proposals outside the support"]["wasted"] > 0 == by[skips.DEFAULT]["wasted"]
    said: list[str] = []
    skips._table(rows, said.append)
    assert any("without: tour" in line for line in said)


def test_exponents():
    size = np.array([1, 10, 100, 1000, 10_000.0])
    assert growth.exponent(size, 3 * size**1.3) == pytest.approx(1.3)
    assert growth.exponent(size, 5 + 1e-3 * size) < 1  # a constant part is no growth
    (row,) = growth.cell({"what": "steps", "size": 16, "material": "ggx:0.3"})
    assert row["cpu_s"] > 0 and row["memory_mb"] > 0


def test_the_guard_warns_and_does_not_fail(tmp_path, monkeypatch):
    rounds = iter([0.1] * 100)
    monkeypatch.setattr(quick, "KERNELS", {"a": lambda: int, "b": lambda: int})
    monkeypatch.setattr(quick, "_ratio", lambda kernel, n: next(rounds))
    reference = tmp_path / "r.json"
    said: list[str] = []
    config = quick.Config(study="quick", reference=str(reference))
    quick.run(config, tmp_path, said.append)
    assert json.loads(reference.read_text()) == {"a": 0.1, "b": 0.1} and "reference written" in said[-1]
    quick.run(config, tmp_path, said.append)
    assert said[-1] == "nothing takes half again as long as in the reference"
    reference.write_text(json.dumps({"a": 0.1, "b": 0.05}))
    quick.run(config, tmp_path, said.append)
    assert said[-1] == "WARNING: b takes 2.00 times as long as in r.json"


def test_the_reference_is_of_the_kernels_there_are():
    assert set(json.loads(quick.REFERENCE.read_text())) == set(quick.KERNELS)


def test_savings_are_read_off_what_plain_reaches():
    """The picture's way has in 50 what plain has in 200: a fourth."""
    rows = [
        {"material": "a", "way": w, "n": n, "measured": n, "flip": 1 / (n * k)}
        for n in (50, 100, 200, 400)
        for w, k in (("plain", 1), ("picture", 4))
    ]
    assert picture_driven._savings(rows, "flip") == [pytest.approx(4)]


def test_every_study_that_ships_is_one(tmp_path):
    import yaml

    for path in (SHIPPED / "studies").glob("*.yaml"):
        assert yaml.safe_load(path.read_text())["study"] in STUDIES
    with pytest.raises(ConfigError, match="is not one of"):
        spoilt = tmp_path / "s.yaml"
        spoilt.write_text("study: astrology\n")
        run_study(spoilt, [], tmp_path, print)
