"""The study of reconstructions, on one small material."""

import json

import numpy as np
import pytest

from gonio.bench.accuracy.reconstruction import Config, run


def test_study_prints_judges_and_plots(tmp_path):
    lines: list[str] = []
    config = Config(
        study="reconstruction",
        materials=("ggx:0.2",),
        models=("auto", "ggx"),
        measurements=(12, 400),
        noise={"none": {}},
        goals={400: 0.15},
    )
    run(config, tmp_path, lines.append)
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert [r["n"] for r in rows] == [12, 12, 400, 400]
    assert "refused" in rows[0]
    assert rows[2]["energy_mean"] < 0.15 and 0.3 < rows[2]["estimate"] < 3
    assert (tmp_path / "error.png").stat().st_size > 10_000
    assert any("met" in line for line in lines)


def test_networks_are_spelled_out(shared_dir):
    file = shared_dir / "materials" / "nbrdf" / "nbrdf.npz"
    config = Config(study="reconstruction", materials=(f"{file}:*",), every=25)
    from gonio.bench.accuracy.reconstruction import materials

    names = materials(config)
    assert len(names) == 5 and all(n.startswith(f"{file}:") for n in names)


def test_unknown_keys_are_errors():
    with pytest.raises(ValueError):
        Config(study="reconstruction", materials=(), model="auto")


def test_rendered_study_says_what_is_seen(tmp_path):
    from gonio.bench.accuracy import rendered

    lines: list[str] = []
    config = rendered.Config(
        study="rendered", materials=("ggx:0.2",), models=("ggx",), sampler="thesis", measurements=200, size=12, spp=2
    )
    rendered.run(config, tmp_path, lines.append)
    ours, _, bsdf, _ = json.loads((tmp_path / "rows.json").read_text())[0]["psnr"]
    assert 20 < bsdf < 130 and 20 < ours < 130 and lines[-1].startswith("worst")


def test_psnr_without_the_noise_of_the_renders():
    """A known difference of 0.01 under noise of 0.05: found; by one render alone it would be drowned."""
    from gonio.bench.accuracy.rendered import noise_free_psnr
    from gonio.render.shade import psnr

    rng = np.random.default_rng(0)
    reference = np.full((2, 60, 60, 3), 0.5)
    images = reference + 0.01 + 0.05 * rng.standard_normal(reference.shape)
    assert abs(noise_free_psnr(images, reference, 1.0) - 40) < 1
    assert psnr(images[0], reference[0]) < 27


@pytest.mark.slow
def test_speed_study_measures_cost_and_table(tmp_path):
    from gonio.bench.speed import reconstruction_speed as study

    lines: list[str] = []
    config = study.Config(
        study="reconstruction_speed",
        material="ggx:0.2",
        sizes=(300,),
        materials=("ggx:0.2",),
        samples=300,
        brushed=(),
        pairs=2000,
    )
    study.run(config, tmp_path, lines.append)
    size, table, *_ = json.loads((tmp_path / "rows.json").read_text())
    assert size["n"] == 300 and size["energy"] < 0.1 and size["seconds"] > 0
    assert table["table"] < 0.005 and all(0 < s < 1 for s in table["spread"])


def test_ablations_change_one_constant_and_put_it_back(tmp_path, monkeypatch):
    from gonio.bench.accuracy import ablations
    from gonio.reconstruct import reconstruct
    from gonio.reconstruct.splines import stretch

    seen = []

    def remember(samples):
        seen.append(stretch.RATIO)
        return reconstruct(samples, "ggx")

    monkeypatch.setattr(ablations, "reconstruct", remember)
    before, lines = stretch.RATIO, []
    config = ablations.Config(
        study="ablations",
        materials=("ggx:0.2",),
        variants={"none": {"stretch.RATIO": 0.0}},
        sampler="thesis",
        measurements=(60,),
    )
    ablations.run(config, tmp_path, lines.append)
    assert seen == [before, 0.0] and stretch.RATIO == before
    with pytest.raises(KeyError), ablations.changed({"stretch.RATIO": 5.0}):
        raise KeyError
    assert stretch.RATIO == before and lines[-1].startswith("mean")
