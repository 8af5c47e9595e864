"""The study of reconstructions, on one small material."""

import json

import pytest

from gonio.bench.reconstruction import Config, run


def test_study_prints_judges_and_plots(tmp_path):
    lines: list[str] = []
    config = Config(
        study="reconstruction",
        materials=("ggx:0.2",),
        models=("auto", "ggx"),
        measurements=(20, 400),
        noise={"none": {}},
        goals={400: 0.15},
    )
    run(config, tmp_path, lines.append)
    rows = json.loads((tmp_path / "rows.json").read_text())
    assert [r["n"] for r in rows] == [20, 20, 400, 400]
    assert "refused" in rows[0]
    assert rows[2]["energy_mean"] < 0.15 and 0.3 < rows[2]["estimate"] < 3
    assert (tmp_path / "error.png").stat().st_size > 10_000
    assert any("met" in line for line in lines)


def test_networks_are_spelled_out(shared_dir):
    file = shared_dir / "materials" / "nbrdf" / "nbrdf.npz"
    config = Config(study="reconstruction", materials=(f"{file}:*",), every=25)
    from gonio.bench.reconstruction import materials

    names = materials(config)
    assert len(names) == 5 and all(n.startswith(f"{file}:") for n in names)


def test_unknown_keys_are_errors():
    with pytest.raises(ValueError):
        Config(study="reconstruction", materials=(), model="auto")
