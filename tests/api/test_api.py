"""What a notebook calls: a function measured, a run opened, a loop of one's own."""

import doctest
import importlib
import subprocess
import sys
from types import ModuleType

import numpy as np
import pytest

import gonio
from gonio.config import ConfigError
from gonio.evaluate import evaluate
from gonio.reconstruct import reconstruct

MODULES = ("gonio", "gonio.api.material", "gonio.api.rig", "gonio.api.measuring", "gonio.api.run", "gonio.api.plot")


def grey(wi, wo):
    return np.full((len(wi), 2), [0.1, 0.2])


def satin(wi, wo):
    h = wi + wo
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    return 0.1 + 2 * np.exp((h[:, 2:] - 1) / 0.02)


def material(n=60, **keys):
    return gonio.Material(name="mine", **{"channels": ["a", "b"], "budget": {"measurements": n}, **keys})


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    with gonio.open_rig("ideal", truth=satin) as rig:
        return gonio.acquire(material(200, channels=["L"]), rig, out=tmp_path_factory.mktemp("runs") / "run")


@pytest.mark.parametrize("name", MODULES)
def test_what_the_docstrings_say_is_so(name):
    failed, _ = doctest.testmod(importlib.import_module(name))
    assert failed == 0


def test_importing_is_light():
    code = "import sys, gonio; print(sorted({m.split('.')[0] for m in sys.modules}))"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert not [m for m in ("numpy", "scipy", "pydantic", "matplotlib", "cv2", "torch", "yaml") if f"'{m}'" in said]


def test_acquire_stays_the_function():
    import gonio.acquire
    from gonio.acquire import Progress

    assert not isinstance(gonio.acquire, ModuleType) and callable(gonio.acquire) and Progress().measured == 0
    assert set(gonio.__all__) <= set(dir(gonio)) and all(getattr(gonio, name) for name in gonio.__all__)


def test_the_stub_names_what_there_is():
    import ast
    from pathlib import Path

    stub = ast.parse(Path(gonio.__file__).with_suffix(".pyi").read_text())
    named = {a.asname for n in ast.walk(stub) if isinstance(n, ast.ImportFrom) for a in n.names if a.asname}
    assert named | {"load_brdf"} == set(gonio.__all__)


def test_a_function_is_measured_and_known_again(run):
    samples = run.samples
    assert len(samples) == 200 and np.allclose(samples.f, satin(samples.wi, samples.wo))
    assert run.ended == "budget of 200 measurements" and "satin" in run.provenance["truth"]
    assert run.evaluate(satin)["energy_mean"] < 0.1
    assert (run.folder / "brdf.npz").exists()


def test_other_models_are_not_saved(run):
    run.brdf()
    before = (run.folder / "brdf.npz").read_bytes()
    figures = evaluate(run.brdf("ggx"), gonio.brdf.models.function.FunctionBrdf(satin))
    assert figures["energy_mean"] != run.evaluate(satin)["energy_mean"]
    assert (run.folder / "brdf.npz").read_bytes() == before
    with pytest.raises(ConfigError, match="no_model"):
        run.brdf("no_model")


def test_a_run_of_a_function_says_that_it_does_not_keep_it(run):
    with pytest.raises(ConfigError, match="what it measured is in no file"):
        run.evaluate()
    with pytest.raises(ConfigError, match="shows a function that it does not keep"):
        gonio.resume(run)


@pytest.mark.slow
def test_the_report_of_a_function(run):
    assert "the caller&#x27;s own satin" in run.report().read_text()


def test_plots(run):
    figure = run.brdf().plot((30, 60), truth=satin)
    assert len(figure.axes) == 2 and figure.axes[0].get_title() == "θi = 30°"
    assert figure.axes[0].collections, "the interval of 95 % is a band"
    with pytest.raises(ValueError, match="theta_i_deg"):
        run.brdf().plot((95,))


@pytest.mark.slow
def test_the_callback_ends_a_run_and_resume_makes_it_the_whole_one(run, tmp_path):
    seen = []

    def stop(progress):
        seen.append(progress.seen)
        return progress.measured < 80

    with gonio.open_rig("ideal", truth=satin) as rig:
        part = gonio.acquire(material(200, channels=["L"]), rig, tmp_path / "part", stop)
        assert part.ended == "" and 80 <= len(part.samples) < 200
        assert sum(len(s.ids) for s in seen) == len(part.samples)
        whole = gonio.resume(part, rig)
    assert np.array_equal(whole.samples.f, run.samples.f) and np.array_equal(whole.samples.wi, run.samples.wi)
    longer = gonio.resume(whole, truth=satin, measurements=230)
    assert len(longer.samples) == 230


def test_what_the_callback_raises_is_raised_and_nothing_is_lost(tmp_path):
    def fail(progress):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        gonio.acquire(gonio.Material("analytic_gloss"), "ideal", tmp_path / "run", fail)
    assert len(gonio.open_run(tmp_path / "run").samples) > 0


def test_devices_show_a_function_too(tmp_path):
    with gonio.open_rig("sim", truth=grey, seed=3) as rig:
        seen = rig.measure(gonio.from_angles([0.5, 0.9], 0.0), gonio.from_angles([0.1, 0.2], 2.0))
        again = rig.measure(gonio.from_angles([0.5, 0.9], 0.0), gonio.from_angles([0.1, 0.2], 2.0))
        run = gonio.acquire(material(12), rig, tmp_path / "run")
    assert seen.f.shape == (2, 2) and np.allclose(seen.f, [0.1, 0.2], rtol=0.2) and (seen.sigma > 0).all()
    assert not np.array_equal(seen.f, again.f), "each reading has its own noise"
    assert len(run.samples) == 12


def test_a_rig_is_let_go_when_it_is_forgotten(monkeypatch, tmp_path):
    """A cell that is run again must not find the rig held by itself, nor the lamp left on."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    rig = gonio.open_rig("bench")
    with pytest.raises(ConfigError, match="is open in this very session"):
        gonio.open_rig("bench")
    closed = []
    rig._owner.close = lambda: closed.append(True)
    del rig
    assert closed == [True]
    gonio.open_rig("bench").close()
    with gonio.open_rig("ideal", truth=grey) as rig:
        pass
    with pytest.raises(ConfigError, match="was closed"):
        rig.measure([[0, 0, 1.0]], [[0, 0.6, 0.8]])
    with pytest.raises(ConfigError, match="was closed"):
        gonio.acquire(material(), rig, tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_rows_come_in_the_order_given():
    theta = np.radians([80, 10, 60, 20, 70.0])
    with gonio.open_rig("ideal", truth=lambda wi, wo: wi[:, 2]) as rig:
        seen = rig.measure(gonio.from_angles(theta, 0.0), gonio.from_angles(theta * 0 + 0.3, 1.0))
    assert np.allclose(seen.f[:, 0], np.cos(theta))


def test_the_same_loop_as_acquire(run):
    """The chain asked by hand asks what `acquire` measured."""
    parts, mine = [], material(200, channels=["L"])
    with gonio.open_rig("ideal", truth=satin) as rig:
        sampler = gonio.make_sampler(mine, rig)
        while sum(map(len, parts)) < 24:
            batch = sampler.ask()
            for seen in rig.visit(batch.wi, batch.wo, batch.ids):
                sampler.tell(seen.ids, seen.f, seen.sigma)
                parts.append(gonio.Samples.of(seen.wi, seen.wo, seen.f))
    f = np.sort(np.concatenate([p.f for p in parts])[:24, 0])
    assert np.allclose(f, np.sort(run.samples.f[:24, 0]))
    assert reconstruct(run.samples, "ggx").channels == 1


def test_dataset(run, tmp_path):
    xarray = pytest.importorskip("xarray", reason="in the notebook extra")
    data = run.to_xarray()
    assert dict(data.sizes) == {"sample": 200, "channel": 1, "axis": 3} and data.f.attrs["units"] == "sr-1"
    assert np.allclose(np.cos(np.radians(data.theta_o_deg)), data.wo.sel(axis="z"))
    assert np.array_equal(data.f.values, run.samples.f) and data.attrs["name"] == "mine"
    if pytest.importorskip("h5netcdf", reason="in the study extra"):
        data.to_netcdf(tmp_path / "x.nc", engine="h5netcdf")
        assert xarray.load_dataset(tmp_path / "x.nc", engine="h5netcdf").equals(data)


@pytest.mark.parametrize(
    ("f", "words"),
    [
        (lambda wi, wo: 0.3, "gave an array"),
        (lambda wi, wo: np.ones((len(wi) + 1, 3)), "gave an array"),
        (lambda wi, wo: np.full(len(wi), np.nan), "not finite"),
        (lambda wi, wo: -np.ones(len(wi)), "below 0"),
        (lambda wi, wo: ["red"] * len(wi), "not an array of numbers"),
        (lambda wi: wi, "not an array of numbers"),
    ],
)
def test_functions_that_are_no_brdf(f, words):
    with pytest.raises(ValueError, match=words):
        gonio.open_rig("ideal", truth=f)


@pytest.mark.parametrize(
    ("make", "error", "words"),
    [
        (lambda: gonio.open_rig("no_rig"), ConfigError, "no_rig"),
        (lambda: gonio.open_rig("bench", truth=grey), ConfigError, "is real"),
        (lambda: gonio.acquire("analytic_gloss", gonio.open_rig("ideal", truth=grey)), ConfigError, "keep one"),
        (lambda: gonio.acquire(material(), gonio.open_rig("ideal")), ConfigError, "truth: missing"),
        (lambda: gonio.acquire(material(channels=3), gonio.open_rig("ideal", truth=grey)), ConfigError, "has 2"),
        (lambda: gonio.open_rig("ideal", truth=grey).measure([[1, 1, 1]], [[0, 0, 1]]), ValueError, "unit vectors"),
        (lambda: gonio.open_rig("ideal", truth=grey).measure([[0, 0, 1]], np.eye(3)), ValueError, "pairs"),
        (lambda: gonio.open_run("nowhere"), ConfigError, "nowhere"),
        (lambda: gonio.Material("no_material"), ConfigError, "no_material"),
        (lambda: gonio.Material(name="a b"), ConfigError, "Material: name"),
        (lambda: gonio.Material(name="a", seed=object()), ConfigError, "Material: seed"),
        (lambda: gonio.Material(), ConfigError, "Material: name: missing"),
    ],
)
def test_mistakes_are_one_line(make, error, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(error, match=words) as caught:
        make()
    assert "\n" not in str(caught.value) and not list(tmp_path.iterdir())


def test_material_from_a_file_and_keywords(tmp_path):
    path = tmp_path / "felt.yaml"
    path.write_text("name: felt\nchannels: [L]\nbudget: {measurements: 500, rig_hours: 2}\n")
    felt = gonio.Material(path, budget={"measurements": np.int64(70)}, sampler={"target": {"floor": 0.2}})
    assert (felt.name, felt.channels, felt.budget.measurements, felt.budget.rig_hours) == ("felt", ("L",), 70, 2)
    assert felt.sampler.target.floor == 0.2 and gonio.Material("chm_orange").truth == "chm_orange"
    assert gonio.Material(name="007").name == "007"
