"""Every file of a run folder appears whole or not at all: killed before the renaming, the old one stays."""

import contextlib
import os
import signal
import sys
import traceback
from pathlib import Path

import numpy as np
import pytest

import gonio.atomic
from gonio.config import Material, load_config
from gonio.config.find import find_config
from gonio.config.rig import RigConfig
from gonio.run import products
from gonio.run.record.config import read_config, write_config
from gonio.run.start import start


def killed_before_the_rename(act) -> None:
    """Run `act` in a child that is killed the moment it would rename a file it wrote."""
    pid = os.fork()
    if pid == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        gonio.atomic.os.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
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
    "brdf.bsdf": lambda run: products.export_run(run, "bsdf"),
    "brdf.binary": lambda run: products.export_run(run, "merl"),
    "grid.npz": lambda run: products.export_run(run, "grid"),
    "samples.csv": lambda run: products.export_run(run, "csv"),
    "samples.parquet": lambda run: products.export_run(run, "parquet"),
    "chains.nc": lambda run: products.export_run(run, "netcdf"),
    "figures/figure_5_1.png": lambda run: products.make_figures(run, "5.1"),
}


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
    assert order == ["sync", "rename"] * 2 and np.load(tmp_path / "b.npy").shape == (3,)
    assert Path(tmp_path / "a").stat().st_mode & 0o444 == 0o444 & ~os.umask(os.umask(0))
