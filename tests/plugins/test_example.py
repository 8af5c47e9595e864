"""The example package of docs/examples: installed, found by its name, conforming, and the detector of a whole run."""

import json
import os
import socket
import struct
import subprocess
import sys
import threading

import numpy as np
import pytest

from tests.conftest import ROOT

EXAMPLE = ROOT / "docs/examples/gonio_example_detector"
NM = np.linspace(380, 780, 2048)
COLOURS = {"R": (600, 700), "G": (500, 580), "B": (420, 490)}


@pytest.fixture(scope="session")
def installed(tmp_path_factory):
    """A folder that the example was installed into."""
    import shutil

    base = tmp_path_factory.mktemp("example")
    shutil.copytree(EXAMPLE, base / "source")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "-q", "--no-deps", "--no-index"]
    install = [*pip, "--no-build-isolation", "--target", base / "site", base / "source"]
    subprocess.run(install, check=True, capture_output=True, timeout=300)
    return base / "site"


class Spectrometer:
    """The far end: a steady spectrum, `counts()` a nominal exposure of 20 ms; served until `close`."""

    def __init__(self, counts):
        self.counts = counts
        self.port, self.peers = 0, []
        self.put()

    def _accept(self, server):
        while True:
            try:
                peer, _ = server.accept()
            except OSError:
                return
            self.peers.append(peer)
            threading.Thread(target=self._serve, args=(peer,), daemon=True).start()

    def _serve(self, peer):
        try:
            while len(asked := peer.recv(7)) == 7:
                micro, pixels = struct.unpack("<IH", asked[1:])
                counts = np.clip(self.counts() * micro / 20_000, 0, 65_535).astype("<u2")
                assert len(counts) == pixels
                peer.sendall(counts.tobytes() + struct.pack("<H", int(counts.sum()) % 65536))
        except OSError:
            pass

    def pull(self):
        """Its network cable."""
        for s in (self.server, *self.peers):
            try:
                s.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass  # gone already
            s.close()
        self.peers = []

    def put(self):
        self.server = socket.create_server(("127.0.0.1", self.port))
        self.port = self.server.getsockname()[1]
        threading.Thread(target=self._accept, args=(self.server,), daemon=True).start()

    close = pull


@pytest.fixture
def spectrometer():
    made = Spectrometer(lambda: 100 + 8000 * np.exp(-(((NM - 560) / 80) ** 2)))
    yield made
    made.close()


def rig_text(port, depth="wire"):
    from gonio.config import load_config
    from gonio.config.rig import RigConfig

    wire = load_config(ROOT / "configs/rigs/wire.yaml", RigConfig).model_dump(mode="json", exclude={"world"})
    polynomial = [380.0, 400.0 / 2047]
    bands = {"bands_nm": list(COLOURS.values()), "polynomial": polynomial, "pixels": 2048}
    where = {"host": "127.0.0.1", "tcp_port": port, "white": 8000.0, "bands": bands}
    noise = {"shot_noise": 0.002, "read_noise": 1e-4, "dark": 0.0125}
    return json.dumps({**wire, "name": "spectral", "detector": {"driver": "example_spectrometer", **where},
                       "photodiode": noise, "depth": depth})  # fmt: skip


def python(installed, code, *args, cwd=None):
    env = {**os.environ, "PYTHONPATH": f"{installed}{os.pathsep}{ROOT}"}
    return subprocess.run([sys.executable, "-c", code, *map(str, args)], cwd=cwd, env=env, capture_output=True,
                          text=True, timeout=120)  # fmt: skip


def test_it_is_short():
    lines = (EXAMPLE / "gonio_example_detector/__init__.py").read_text().splitlines()
    assert len([line for line in lines if line.strip()]) <= 60


def test_it_conforms(installed, spectrometer, monkeypatch):
    monkeypatch.syspath_prepend(str(installed))
    from gonio_example_detector import Spectrometer as Driver
    from gonio_example_detector import SpectrometerConfig

    from gonio.testing import check_detector, setting

    bands = {"bands_nm": list(COLOURS.values()), "wavelengths_nm": NM.tolist()}
    config = SpectrometerConfig(host="127.0.0.1", tcp_port=spectrometer.port, bands=bands)
    noise = {"photodiode": {"read_noise": 1e-3}}
    check_detector(lambda: Driver(config, setting(**noise)), fault=spectrometer.pull, mend=spectrometer.put)


CHECK = "import sys; sys.argv = ['gonio', 'check', sys.argv[1], '--rig', sys.argv[2]]; import gonio.cli as c; c.main()"
MEASURE = """
import sys, numpy as np
from gonio.brdf.models.lambert import Lambert
from gonio.config import load_config
from gonio.config.rig import RigConfig
from gonio.run.open_rig import open_rig
rig = open_rig(load_config(sys.argv[1], RigConfig), Lambert([0.3, 0.2, 0.1]), 1)
at = lambda deg: np.array([[np.sin(np.radians(deg)), 0, np.cos(np.radians(deg))]])
(seen,) = rig.visit(at(-30), at(40), np.arange(1))
print(rig.detector.channels, *((seen.raw[0]["peak"], *seen.f[0]) if np.isfinite(seen.f).all() else "?"))
rig.close()
"""


def test_a_rig_finds_it_by_its_name(installed, spectrometer, tmp_path):
    """Its keys are checked with file, line and key; a reading comes through the whole rig."""
    rig = tmp_path / "rig.yaml"
    rig.write_text(rig_text(spectrometer.port))
    said = python(installed, CHECK, "analytic_gloss", rig)
    assert "driver example_spectrometer" in said.stdout, said.stdout + said.stderr
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text(rig_text(spectrometer.port).replace('"tcp_port"', '"tcp_prt"'))
    said = python(installed, CHECK, "analytic_gloss", wrong)
    assert said.returncode == 2 and "wrong.yaml:1: detector.tcp_port: missing" in said.stderr, said.stderr
    said = python(installed, MEASURE, rig)
    assert said.returncode == 0, said.stderr
    channels, peak, *f = said.stdout.split()
    assert channels == "3" and int(peak) == 8099 and len(f) == 3
    without = python(tmp_path, CHECK, "analytic_gloss", rig)
    assert without.returncode == 2
    assert "detector.driver: example_spectrometer is not installed; there is photodiode, text" in without.stderr
