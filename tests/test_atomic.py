"""Every file of a run folder appears whole or not at all: killed before the renaming, the old one stays."""

import ast
import contextlib
import datetime as dt
import itertools
import os
import shutil
import signal
import sys
import traceback
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gonio.atomic
from calibration.take_view import take_view
from gonio.bench.runner import run_study
from gonio.brdf import Lambert
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.loader import Section
from gonio.config.rig import RigConfig
from gonio.export.mountain import write_mountain
from gonio.load import save_brdf
from gonio.render.beside import render_beside
from gonio.rig.calibration import GeometryCalibration, save_calibration
from gonio.rig.signal.frames import Frames
from gonio.run import products
from gonio.run.exports import export_run
from gonio.run.record.config import read_config, write_config
from gonio.run.start import start
from tests.conftest import ROOT


def killed_before_the_rename(act, number: int = 1, folder: Path = Path("/")) -> None:
    """Run `act` in a child that is killed when it would rename the file it wrote as its `number`-th in `folder`."""
    pid = os.fork()
    if pid == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        replace, count = os.replace, itertools.count(1)

        def replacing(part, path):
            if Path(path).is_relative_to(folder) and next(count) == number:
                os.kill(os.getpid(), signal.SIGKILL)
            replace(part, path)

        gonio.atomic.os.replace = replacing
        try:
            act()
        except BaseException:
            traceback.print_exc(file=sys.__stdout__)
        os._exit(0)
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL, "it did not write beside and rename"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A small run with its products."""
    folder = tmp_path_factory.mktemp("whole") / "run"
    material = load_config(find_config("analytic_gloss", "materials"), Material, ["budget.measurements=150"])
    with contextlib.closing(start(material, load_config(find_config("ideal", "rigs"), RigConfig), folder)) as r:
        r()
    products.make_products(folder)
    return folder


PRODUCTS = {
    "config.yaml": lambda run: write_config(run, read_config(run)),
    "brdf.npz": products.make_brdf,
    "report.html": products.make_report,
    "brdf.bsdf": lambda run: export_run(run, "bsdf"),
    "brdf.binary": lambda run: export_run(run, "merl"),
    "grid.npz": lambda run: export_run(run, "grid"),
    "samples.csv": lambda run: export_run(run, "csv"),
    "samples.parquet": lambda run: export_run(run, "parquet"),
    "chains.nc": lambda run: export_run(run, "netcdf"),
    "figures/figure_5_1.png": lambda run: products.make_figures(run, "5.1"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", PRODUCTS)
def test_killed_while_a_product_is_made_the_old_one_stays(run, name):
    if name.endswith(".parquet"):
        pytest.importorskip("pyarrow")
    if name.endswith(".nc"):
        pytest.importorskip("h5netcdf")
    path = run / name
    path.parent.mkdir(exist_ok=True)
    if not path.exists():
        path.write_bytes(b"the old one")
    before = path.read_bytes()
    killed_before_the_rename(lambda: PRODUCTS[name](run))
    assert path.read_bytes() == before
    for left in path.parent.glob(".*part*"):
        left.unlink()


def geometry(folder):
    when = dt.datetime(2026, 11, 26, tzinfo=dt.UTC)
    found = GeometryCalibration(id="g", date=when, rig="r", offsets_deg={"light": 1.0}, residual_deg=0.1)
    save_calibration(found, folder)


def frames(folder):
    dark = np.zeros((1, 4, 4, 3))
    Frames((0.1,), dark, 5, np.zeros((4, 4), bool), None, "f", "2026-11-26T00:00:00Z").save(folder)


def study(folder):
    path = folder.parent / "study.yaml"
    path.write_text("{study: codes, archive: none}")
    module = SimpleNamespace(Config=Study, run=lambda config, out, say: say("a line"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gonio.bench.runner.import_module", lambda name: module)
        run_study(path, [], folder, lambda line: None)


class Study(Section):
    study: str
    archive: str


def pictures(folder):
    """Without a renderer: it is the files that count."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gonio.render.beside.render", lambda *_: np.zeros((4, 4, 3)))
        patch.setattr("gonio.render.beside.compare", lambda *_: {"PSNR": 1.0})
        patch.setattr("gonio.render.beside.OBJECTS", ("sphere",))
        render_beside(Lambert([0.1, 0.2, 0.3]), Lambert([0.1, 0.2, 0.3]), None, folder, 4, 1)


def view(folder):
    camera = SimpleNamespace(
        config=SimpleNamespace(exposure_s=(0.1,)), known=lambda: SimpleNamespace(dark=np.zeros((1, 4, 4, 3))),
        frame=lambda t: np.ones((4, 4, 3)), source=SimpleNamespace(full_scale=255.0),
    )  # fmt: skip
    light = SimpleNamespace(on=lambda: None, level=lambda x: None, off=lambda: None)
    config = SimpleNamespace(name="r", detector="camera", axis_names=("light",))
    stage = SimpleNamespace(pose=lambda: np.zeros(1))
    rig = SimpleNamespace(config=config, detector=SimpleNamespace(camera=camera), light=light, stage=stage)
    take_view(rig, folder / "view.png", folder / "poses.csv")


def board(folder):
    from gonio.cli import main

    with pytest.MonkeyPatch.context() as patch, contextlib.suppress(SystemExit):
        patch.setattr(sys, "argv", ["gonio", "calibrate", "camera", "--board", str(folder / "board.png")])
        main()


def mountain(folder):
    write_mountain(Lambert([0.3]), folder, (0, 30), "a")


def density(folder):
    save_brdf(Lambert([0.3]), folder / "flow_density.npz")


# what makes them, and all the files that it makes
FILES = {
    geometry: ["g.yaml"],
    frames: ["f.npz"],
    study: ["table.txt"],
    pictures: ["render.png", "render.json"],
    view: ["view.png", "poses.csv"],
    board: ["board.png"],
    mountain: ["a_00.0.txt", "a_30.0.txt"],
    density: ["flow_density.npz"],
}


@pytest.mark.parametrize("make", FILES)
def test_killed_at_each_renaming_every_file_is_an_old_one_or_a_new_one(tmp_path, make):
    whole, torn = tmp_path / "whole", tmp_path / "torn"
    whole.mkdir()
    make(whole)
    assert sorted(p.name for p in whole.iterdir()) == sorted(FILES[make])
    for number, last in enumerate(FILES[make], 1):
        shutil.rmtree(torn, ignore_errors=True)
        torn.mkdir()
        for name in FILES[make]:
            (torn / name).write_bytes(b"old")
        killed_before_the_rename(lambda: make(torn), number, torn)
        kept = [(torn / name).read_bytes() == b"old" for name in FILES[make]]
        assert kept[number - 1 :] == [True] * (len(kept) - number + 1), f"{last} was touched"
        assert not any(kept[: number - 1])


WRITES = {"write_text", "write_bytes", "savefig", "savez", "savez_compressed", "imwrite", "to_netcdf", "write_table"}
MODES = {"w", "wb", "a", "ab", "x", "xb", "w+", "r+", "r+b"}
# another way of their own: scratch for a renderer; a part that is gone on with; a log whose lines are added
BY_THEMSELVES = {"gonio/render/objects.py", "gonio/brdf/download.py", "gonio/run/record/store.py"}
BY_THEMSELVES.add("gonio/export/renderers/radiance.py")  # in a temporary folder of its own


def written_in_place(text: str) -> list[int]:
    """Lines that write a file outside any `with beside(...)` or `with replacing(...)`, or a buffer named so."""
    found = []

    def walk(node, safe):
        if isinstance(node, ast.With):
            names = {i.context_expr.func.id for i in node.items
                     if isinstance(i.context_expr, ast.Call) and isinstance(i.context_expr.func, ast.Name)}  # fmt: skip
            safe = safe or bool(names & {"beside", "replacing"})
        if isinstance(node, ast.Call) and not safe:
            first = node.args[0] if node.args else None
            buffer = isinstance(first, ast.Name) and first.id in ("buffer", "stream")
            name = getattr(node.func, "attr", getattr(node.func, "id", ""))
            modes = {a.value for a in node.args if isinstance(a, ast.Constant)}
            direct = name in WRITES and isinstance(node.func, ast.Attribute) and not buffer
            if direct or (name == "open" and modes & MODES):
                found.append(node.lineno)
        for child in ast.iter_child_nodes(node):
            walk(child, safe)

    walk(ast.parse(text), False)
    return found


def test_nothing_is_written_in_place():
    files = [p for room in ("gonio", "drivers", "sim", "calibration") for p in (ROOT / room).rglob("*.py")]
    found = {str(p.relative_to(ROOT)): written_in_place(p.read_text()) for p in files}
    assert not {k: v for k, v in found.items() if v and k not in BY_THEMSELVES}
    assert written_in_place("with beside(p) as q:\n    f.savefig(q)\np.write_text(t)\nopen(p, 'w')") == [3, 4]


def test_after_an_error_nothing_is_left(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(OSError, match="full"), gonio.atomic.replacing(path) as stream:
        stream.write(b"new")
        raise OSError("full")
    assert path.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_what_is_written_is_on_the_disk_before_it_is_renamed(tmp_path, monkeypatch):
    order = []
    sync, replace = os.fsync, os.replace
    monkeypatch.setattr(gonio.atomic.os, "fsync", lambda fd: (order.append("sync"), sync(fd)))
    monkeypatch.setattr(gonio.atomic.os, "replace", lambda *a: (order.append("rename"), replace(*a)))
    gonio.atomic.write_text(tmp_path / "a", "text")
    with gonio.atomic.beside(tmp_path / "b.npy") as part:
        np.save(part, np.zeros(3))
    assert order == ["sync", "rename", "sync"] * 2  # the file, its name, the folder that holds the name
    assert np.load(tmp_path / "b.npy").shape == (3,)
    assert Path(tmp_path / "a").stat().st_mode & 0o444 == 0o444 & ~os.umask(os.umask(0))


def test_what_a_killed_process_left_is_swept_a_day_later(tmp_path):
    old, young, other = tmp_path / ".a.x.part.txt", tmp_path / ".a.y.part.txt", tmp_path / ".b.x.part.txt"
    for part in (old, young, other):
        part.write_text("half")
    for part in (old, other):
        os.utime(part, (0, 0))
    gonio.atomic.write_text(tmp_path / "a.txt", "whole")
    assert {p.name for p in tmp_path.iterdir()} == {"a.txt", young.name, other.name}


def test_a_run_killed_while_its_folder_is_made_leaves_the_name_free(tmp_path):
    from gonio.run.record.store import Store

    child = os.fork()
    if child == 0:
        gonio.atomic.os.rename = lambda *_: os._exit(9)
        Store.create(tmp_path / "run", "name: x", {})
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 9
    (left,) = tmp_path.iterdir()
    assert left.name.startswith(".run.")
    strange = tmp_path / ".download.part"  # another program's
    strange.write_text("half")
    os.utime(left, (0, 0))
    os.utime(strange, (0, 0))
    Store.create(tmp_path / "run", "name: x", {}).close()
    assert {p.name for p in tmp_path.iterdir()} == {"run", strange.name}
