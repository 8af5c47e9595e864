"""The firmware's core, compiled as a program on a pseudo-terminal, and the drivers that speak to it."""

import os
import shutil
import struct
import subprocess
import tty

import numpy as np
import pytest

from drivers.doctor import doctor
from drivers.doors import Lamp, SerialPhotodiode
from drivers.text_line import checksum
from gonio.config.devices import DevicesConfig, InstrumentPortConfig, LampConfig, PhotodiodePort
from gonio.rig.clock import VirtualClock
from gonio.rig.errors import DeviceFault
from gonio.testing import check_detector, check_light, setting
from tests.conftest import ROOT

SOURCE = ROOT / "drivers/firmware"
SIGNAL = [1.0, 20.0, 0.01]
NOISE = {"shot_noise": 0.0, "read_noise": 1e-4, "dark": 1e-3}


@pytest.fixture(scope="session")
def program(tmp_path_factory):
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("needs g++, which is not here")
    out = tmp_path_factory.mktemp("firmware") / "host"
    flags = ["-std=c++11", "-Wall", "-Wextra", "-Werror", "-O1", "-fsanitize=undefined,address", "-static-libasan"]
    source = SOURCE / "host/main.cpp"
    done = subprocess.run([compiler, *flags, "-o", out, source], capture_output=True, text=True, timeout=120)
    if (done.returncode and "sanitize" in done.stderr + done.stdout) or "asan" in done.stderr:
        done = subprocess.run([compiler, *flags[:5], "-o", out, source], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return out


class Board:
    """The program at the far end of a pseudo-terminal, `port`."""

    def __init__(self, program, role, shared):
        self.host, slave = os.openpty()
        tty.setraw(slave)
        self.slave, self.port = slave, os.ttyname(slave)
        self.process = subprocess.Popen([program, role, shared], stdin=self.host, stdout=self.host)

    def close(self):
        for fd in (self.slave, self.host):
            os.close(fd)
        self.process.terminate()
        self.process.wait(10)


@pytest.fixture
def bench(program, tmp_path):
    """bench(role) -> Board; bench.put(k, value), bench.get(k): the light between them."""
    shared = tmp_path / "light"
    shared.write_bytes(struct.pack("<6d", 0.0, 0.0, *SIGNAL, -1.0))
    boards = []

    def make(role):
        boards.append(Board(program, role, shared))
        return boards[-1]

    def put(k, value):
        with shared.open("r+b") as f:
            f.seek(8 * k)
            f.write(struct.pack("<d", value))

    make.put, make.get = put, lambda k: struct.unpack_from("<d", shared.read_bytes(), 8 * k)[0]
    yield make
    for board in boards:
        board.close()


def test_the_photodiode_conforms(bench):
    port = bench("photodiode").port
    bench.put(0, 1.0)
    s = setting(VirtualClock(), photodiode=NOISE)
    check_detector(lambda: SerialPhotodiode(PhotodiodePort(port=port, boot_s=0), s))


def test_the_lamp_conforms(bench):
    port = bench("lamp").port
    s = setting(VirtualClock())
    check_light(lambda: Lamp(LampConfig(port=port, boot_s=0), s), lit=lambda: bench.get(0) > 0)


def test_readings_are_right(bench):
    """Ranges found, signals that grow with the exposure, and saturated beyond the highest range."""
    bench.put(0, 1.0)
    detector = SerialPhotodiode(PhotodiodePort(port=bench("photodiode").port), setting(photodiode=NOISE))
    detector.connect()
    assert detector.channels == 3 and detector.full_scale.tolist() == [8, 240, 7200]
    for seconds in (0.02, 0.1):
        r = detector.read(seconds)
        full = np.array(r.raw["full_scale"])
        np.testing.assert_allclose(r.value, (np.array(SIGNAL) + 1e-3) * seconds / 0.02, atol=full.max() / 65535)
        assert not r.saturated
    assert r.raw["range"] == [0, 1, 0]
    bench.put(3, 1e5)
    r = detector.read()
    assert r.saturated and r.raw["range"][1] == 2
    detector.close()


def test_the_lamp_obeys_its_level_and_its_interlock(bench):
    lamp = Lamp(LampConfig(port=bench("lamp").port), setting(VirtualClock()))
    lamp.connect()
    lamp.level(0.25)
    assert bench.get(0) == 0
    lamp.on()
    assert bench.get(0) == 0.25
    bench.put(1, 1.0)
    with pytest.raises(DeviceFault, match="light: interlock open; close the door"):
        lamp.confirm()
    assert bench.get(0) == 0
    bench.put(1, 0.0)
    lamp.off()
    lamp.on()
    assert bench.get(0) == 0.25
    lamp.close()


def test_the_doctor_on_both(bench):
    """The photodiode sees the lamp: they share the light of one file."""
    s = setting(photodiode=NOISE)
    devices = DevicesConfig(
        photodiode=InstrumentPortConfig(port=bench("photodiode").port), light=LampConfig(port=bench("lamp").port)
    )
    lines = doctor(s.rig, devices)
    assert "ok   photodiode: 3 channels, dark level 0.00" in "\n".join(lines), lines
    assert any(line.startswith("ok   light: on/off contrast 1.03e+03") for line in lines), lines


def ask(board, data):
    os.write(board.slave, data)
    answer = b""
    while not answer.endswith(b"\n"):
        answer += os.read(board.slave, 1000)
    return answer


def said(text):
    return text + b"*%02X\n" % checksum(text)


@pytest.mark.parametrize(
    ("command", "answer"),
    [
        (b"CONF:RANG 1,0,2", b"CONF:RANG 1,0,2"),
        (b"CONF:RANG 1,0,3", b"ERR -113,undefined header"),
        (b"CONF:RANG 1,0", b"ERR -113,undefined header"),
        (b"CONF:RANG 1,0,0,0", b"ERR -113,undefined header"),
        (b"CONF:RANG 1,0,", b"ERR -113,undefined header"),
        (b"READ? nan", b"ERR -113,undefined header"),
        (b"READ? -1", b"ERR -113,undefined header"),
        (b"READ? 0x1", b"ERR -113,undefined header"),
        (b"FETC?", b"FETC?"),
        (b"OUTP 1", b"ERR -113,undefined header"),
        (b"*IDN?", b"*IDN? gonio,photodiode,0,1,3"),
        (b"SYST:ERR?", b'SYST:ERR? 0,"No error"'),
        (b"", b"ERR -113,undefined header"),
        (b"READ? " + b"1" * 200, b"ERR -113,undefined header"),
    ],
)
def test_commands_word_by_word(bench, command, answer):
    assert ask(bench("photodiode"), said(command)) == said(answer)


def test_mutated_commands_are_answered_or_refused(bench):
    """300 damaged lines, under the sanitizers: one answer each with a right sum, and the board lives on."""
    rng = np.random.default_rng(0)
    board = bench("photodiode")
    whole = [b"READ? 0.0", b"CONF:RANG 0,1,2", b"*IDN?", b"FETC?", b"CONF:FULL?"]
    refused = 0
    for _ in range(300):
        text = bytearray(whole[int(rng.integers(len(whole)))])
        for _ in range(int(rng.integers(1, 5))):
            at = int(rng.integers(len(text) + 1))
            text[at:at] = bytes([int(rng.integers(1, 256))]) * int(rng.choice([1, 1, 1, 300]))
        text = bytes(text).replace(b"\n", b"").replace(b"\r", b"")
        line = said(text) if rng.random() < 0.7 else text + b"*00\n"
        answer = ask(board, line)
        body, _, total = answer.rstrip(b"\n").rpartition(b"*")
        assert int(total, 16) == checksum(body)
        refused += body.startswith(b"ERR")
    assert refused > 200
    assert ask(board, said(b"*IDN?")) == said(b"*IDN? gonio,photodiode,0,1,3")
    assert board.process.poll() is None


def test_the_sketch_needs_nothing_but_the_core():
    """No Arduino header in the core; the sketch includes the core alone."""
    core = (SOURCE / "gonio_board/core.h").read_text()
    sketch = (SOURCE / "gonio_board/gonio_board.ino").read_text()
    included = [line.split()[1] for line in core.splitlines() if line.startswith("#include")]
    assert set(included) == {"<stdint.h>", "<stdlib.h>", "<string.h>"}
    assert [line for line in sketch.splitlines() if line.startswith("#include")] == ['#include "core.h"']


@pytest.mark.parametrize("role", ["PHOTODIODE", "LAMP"])
def test_the_sketch_compiles(program, tmp_path, role):
    """Against a stand-in for what the Arduino core declares: no board is here to run it."""
    stub = "#include <stddef.h>\nenum { A0 = 14, OUTPUT, INPUT_PULLUP, HIGH = 1 };\nvoid pinMode(int, int);\n"
    stub += "void digitalWrite(int, int);\nint digitalRead(int);\nint analogRead(int);\nvoid analogWrite(int, int);\n"
    stub += "unsigned long micros();\nstruct Port { void begin(long); int available(); int read(); "
    stub += "void print(const char*); }"
    sketch = (SOURCE / "gonio_board/gonio_board.ino").read_text().replace("#define PHOTODIODE", f"#define {role}")
    path = tmp_path / "sketch.cpp"
    path.write_text(f"{stub};\nextern Port Serial;\n{sketch}")
    flags = ["-std=c++11", "-Wall", "-fsyntax-only", f"-I{SOURCE / 'gonio_board'}"]
    done = subprocess.run(["g++", *flags, path], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
