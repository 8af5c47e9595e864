"""The Grbl driver on an emulated controller: homing, moves, stops, limits read back, alarms and errors by number."""

import re
import threading

import numpy as np
import pytest

from drivers.doctor import doctor
from drivers.doors import Grbl
from drivers.grbl import codes
from drivers.grbl.controller import Controller, Report
from gonio.brdf.models.lambert import Lambert
from gonio.config import ConfigError, load_config
from gonio.config.rig import RigConfig
from gonio.rig.clock import ScaledClock
from gonio.rig.driver import Setting
from gonio.rig.errors import DeviceFault, SafetyStop
from gonio.run.open_rig import open_rig
from gonio.testing import check_stage
from sim.sample import Sample
from sim.wire.arms import Steppers
from sim.wire.line import Line, Server
from sim.wire.rig import Emulators
from tests.conftest import ROOT

CONFIG = load_config(ROOT / "configs/rigs/stepper.yaml", RigConfig)
FAR = np.radians([40.0, -100.0, -60.0, 90.0])


class Bench:
    def __init__(self, folder, scale=20.0):
        self.clock = ScaledClock(scale)
        self.steppers = Steppers(CONFIG, CONFIG.devices.stage, self.clock)
        self.device = self.steppers.device
        self.line = Line(folder / "grbl", self.device)
        self.server = Server([self.line])
        self.stage = self.make()

    def make(self):
        section = CONFIG.devices.stage.model_copy(update={"port": str(self.line.path), "boot_s": 0})
        return Grbl(section, Setting(CONFIG, self.clock))

    def angles(self):
        return np.radians(self.steppers.angles_deg())

    def close(self):
        self.stage.close()
        self.server.close()


@pytest.fixture
def bench(tmp_path):
    b = Bench(tmp_path)
    yield b
    b.close()


@pytest.fixture
def homed(bench):
    bench.stage.connect()
    bench.stage.home()
    return bench


def test_it_conforms(bench):
    check_stage(bench.make, fault=lambda: bench.server.unplug(bench.line), mend=lambda: bench.server.plug(bench.line))


def test_nothing_moves_before_it_is_home(bench):
    bench.stage.connect()
    assert bench.device.lines == ["$$"] and not bench.stage.homed
    with pytest.raises(DeviceFault, match="stage: does not know where it is; `gonio home`"):
        bench.stage.move(np.zeros(4), 60.0)
    assert bench.device.lines == ["$$"]
    bench.stage.home()
    assert bench.device.lines == ["$$", "$H"] and bench.stage.homed
    np.testing.assert_allclose(np.degrees(bench.stage.pose()), [-85, 180, 85, 180], atol=1e-6)
    bench.stage.home()  # it is: nothing is driven
    assert bench.device.lines == ["$$", "$H"]


def test_a_move_is_one_straight_line_of_its_time(homed):
    """The arms are where the driver says; the feed is such that the slowest axis goes at its own speed."""
    at = homed.stage.move(FAR, 60.0)
    np.testing.assert_allclose(at, FAR, atol=np.radians(1e-3))
    np.testing.assert_allclose(homed.angles(), FAR, atol=np.radians(1e-3))
    line = homed.device.lines[-1]
    assert line.startswith("G90 G53 G1 X-130.000 Y-285.000 Z-150.000 A-95.000 F")
    way = np.abs(np.degrees(FAR) - [-85, 180, 85, 180])
    assert float(line.rpartition("F")[2]) == pytest.approx(60 * np.linalg.norm(way) / (way / 60).max(), rel=1e-4)
    again = homed.stage.move(FAR, 60.0)  # there is nothing to do
    np.testing.assert_allclose(again, at) and len(homed.device.lines) == 3


def test_what_lies_outside_is_not_sent(homed):
    before = list(homed.device.lines)
    for k, wrong in ((0, 87.0), (1, -181.0), (2, float("nan"))):
        goal = np.zeros(4)
        goal[k] = np.radians(wrong)
        with pytest.raises(SafetyStop, match=f"{homed.stage.axes[k].name}: .*lies outside its limits"):
            homed.stage.move(goal, 60.0)
    assert homed.device.lines == before


def test_a_stop_in_a_move_keeps_the_position(homed, monkeypatch):
    """Feed hold, at rest, then the reset: an alarm would mean lost steps."""
    report = homed.stage.controller.report
    seen = []

    def watched():
        r = report()
        seen.append(r.state)
        if r.state == "Run" and seen.count("Run") == 2:
            homed.stage.stop()
        return r

    monkeypatch.setattr(homed.stage.controller, "report", watched)
    at = homed.stage.move(FAR, 60.0)
    assert "Hold" in seen or seen[-1] == "Idle"
    assert homed.device.state == "Idle" and homed.stage.homed
    np.testing.assert_allclose(at, homed.angles(), atol=np.radians(2e-3))
    assert np.abs(at - FAR).max() > np.radians(1)
    homed.stage.allow()
    np.testing.assert_allclose(homed.stage.move(FAR, 60.0), FAR, atol=np.radians(1e-3))


def test_a_stop_at_rest_leaves_no_hold_behind(homed):
    homed.stage.stop()
    assert homed.device.state == "Idle" and homed.stage.homed
    homed.stage.allow()
    np.testing.assert_allclose(homed.stage.move(FAR, 60.0), FAR, atol=np.radians(1e-3))


def test_homing_is_stopped_by_a_reset(bench, monkeypatch):
    """It listens to nothing else: from another thread, and where the wait is interrupted."""
    bench.stage.connect()
    bench.device.endless = True
    result = {}

    def home():
        try:
            bench.stage.home()
        except DeviceFault as e:
            result["fault"] = str(e)

    under_way, obey = threading.Event(), bench.device._home
    monkeypatch.setattr(bench.device, "_home", lambda: [under_way.set(), *obey()][1:])
    thread = threading.Thread(target=home)
    thread.start()
    assert under_way.wait(30)
    bench.stage.stop()
    thread.join(30)
    assert result == {"fault": "stage: homing was interrupted; `gonio home` again"}
    assert bench.device.state == "Alarm" and not bench.stage.homed
    bench.stage.allow()
    under_way.clear()
    controller = bench.stage.controller

    def interrupted(end):
        assert under_way.wait(30)
        raise KeyboardInterrupt

    with monkeypatch.context() as m:
        m.setattr(controller, "_line", interrupted)
        with pytest.raises(KeyboardInterrupt):
            bench.stage.home()
    with pytest.raises(DeviceFault, match="homing was interrupted"):
        controller.report()
    assert bench.device.state == "Alarm"


@pytest.mark.parametrize(
    ("setting", "value", "words"),
    [
        (130, 100.0, r"light: \$130 allows a travel of 100 degrees, the rig's YAML needs 172; set \$130"),
        (111, 600.0, r"turntable: \$111 allows a rate of 600 degrees/min, the rig's YAML needs 3564"),
        (122, 50.0, r"detector: \$122 allows a acceleration of 50 degrees/s2, the rig's YAML needs 118.8"),
        (133, None, r"azimuth: the controller has no \$133 \(travel of A\); check devices.stage.axes"),
        (10, 0.0, r"stage: reports '<\w+\|WPos:.*no machine position; set \$10=1"),
    ],
)
def test_limits_are_read_back(bench, setting, value, words):
    if value is None:
        del bench.device.settings[setting]
    else:
        bench.device.settings[setting] = value
    with pytest.raises(DeviceFault, match=words):
        bench.stage.connect()
        bench.stage.home()


def test_alarms_and_errors_are_named(homed):
    d, stage = homed.device, homed.stage
    d.stuck = True
    with pytest.raises(DeviceFault, match="stage: a limit switch was hit: the position is lost; free the arm"):
        stage.move(FAR, 60.0)
    assert not stage.homed
    with pytest.raises(DeviceFault, match="does not know where it is"):
        stage.move(FAR, 60.0)
    stage.home()
    d.state = "Alarm"
    with pytest.raises(DeviceFault, match="stage: is locked after an alarm; `gonio home`"):
        stage.move(FAR, 60.0)
    d.lost_switch = True
    with pytest.raises(DeviceFault, match="stage: homing does not find a limit switch; check the switch"):
        stage.home()
    d.lost_switch, d.settings[22] = False, 0.0
    with pytest.raises(DeviceFault, match=r"stage: homing is not enabled \(error 5 to \$H\); enable it"):
        stage.home()
    d.settings[22] = 1.0
    stage.home()
    d.settings[130] = 60.0  # somebody changed it: its own soft limits
    with pytest.raises(DeviceFault, match="stage: a move beyond its travel was refused; check"):
        stage.move(FAR, 60.0)
    d.state = "Door"
    with pytest.raises(DeviceFault, match="its safety door is open; close it"):
        stage.move(FAR, 60.0)


def test_one_that_does_not_move_is_named(homed):
    homed.device.frozen = True
    with pytest.raises(DeviceFault, match=r"turntable: stopped 280.0 degrees short; free it"):
        homed.stage.move(FAR, 60.0)


def test_every_number_has_a_remedy():
    for table in (codes.ALARMS, codes.ERRORS):
        assert all(cause and remedy for cause, remedy, *_ in table.values())
    assert codes.alarm(77)[0] == "alarm 77" and codes.alarm(77)[2] and "error 99" in codes.error(99)[0]


def test_a_controller_that_restarts(bench, monkeypatch):
    """Deaf, a banner, then as usual; the next opening finds that it has forgotten where it is."""
    monkeypatch.setattr("drivers.grbl.controller.POKE_S", 0.01)
    bench.device.deaf_to = 5
    bench.stage.controller.boot_s = 60.0
    bench.stage.connect()
    assert bench.stage.controller.banner.startswith("Grbl 1.1h")
    bench.stage.home()
    bench.stage.move(FAR, 60.0)
    bench.server.unplug(bench.line)
    with pytest.raises(DeviceFault, match=r"stage: .* is gone; plug in its USB cable, then `gonio home`"):
        bench.stage.move(np.zeros(4), 60.0)
    assert not bench.stage.homed


@pytest.mark.parametrize(
    "answer", [b"", b"Marlin 2.1\r\necho:Unknown command\r\n", b"\xff\xfe\x00" * 50, b"<Idle|\r\n"]
)
def test_something_else_on_the_port(bench, monkeypatch, answer):
    monkeypatch.setattr("drivers.grbl.controller.TIMEOUT_S", 0.05)
    monkeypatch.setattr("drivers.grbl.controller.POKE_S", 0.01)
    bench.device.receive = lambda data: [answer] if answer else []
    with pytest.raises(DeviceFault, match="stage: no reply to \\?") as e:
        bench.stage.connect()
    assert "\n" not in str(e.value)


def test_mutated_reports_are_read_or_refused(bench):
    """300 damaged lines: a report of finite numbers, a DeviceFault, or silence."""
    rng = np.random.default_rng(0)
    lines = [b"<Idle|MPos:0.000,-12.500,3.250,0.000|FS:0,0|WCO:0.000,0.000,0.000>", b"ALARM:9", b"<Hold:1|MPos:1,2,3>"]
    read = refused = 0
    c = Controller("-", 115200, 0)
    for _ in range(300):
        data = bytearray(lines[int(rng.integers(3))])
        for _ in range(int(rng.integers(1, 4))):
            at = int(rng.integers(len(data)))
            piece = [b"nan", b"inf", b"1e400", b"|", b":", b"\xff", b",,"][int(rng.integers(7))]
            data[at : at + int(rng.integers(0, 3))] = piece if rng.random() < 0.5 else bytes([int(rng.integers(256))])
        text = bytes(data).decode("ascii", "backslashreplace").strip()
        try:
            from drivers.grbl.controller import REPORT, _report

            c._raise_alarm(text)
            if (found := REPORT.fullmatch(text)) is not None:
                r = _report(found, text)
                assert isinstance(r, Report) and np.isfinite(r.machine).all()
                read += 1
        except DeviceFault as e:
            refused += 1
            assert "\n" not in str(e)
    assert read > 20 and refused > 50


def test_a_run_on_steppers():
    """A whole rig: homed at its opening, measured, where the arms truly are."""
    rig = open_rig(CONFIG, Lambert([0.3, 0.2, 0.1]), 1)
    assert rig.stage.homed and rig.emulators.arms.device.lines[1] == "$H"
    rng = np.random.default_rng(2)
    wi, wo = (np.array([[np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)] for t, p in zip(*angles)])
              for angles in rng.uniform(0, 1.3, (2, 2, 10)))  # fmt: skip
    seen = list(rig.visit(wi, wo, np.arange(10)))
    f = np.concatenate([v.f for v in seen])
    good = np.isfinite(f).all(1)
    assert good.sum() >= 7
    np.testing.assert_allclose(f[good], np.tile(np.array([0.3, 0.2, 0.1]) / np.pi, (good.sum(), 1)), rtol=0.1)
    rig.park()
    np.testing.assert_allclose(rig.emulators.angles_deg(), [-45, 0, 45, 0], atol=0.01)
    rig.close()


def test_the_doctor_on_a_controller():
    there = Emulators(CONFIG, Sample(Lambert([0.3, 0.2, 0.1])), 1)
    there.arms.device.put(np.array([-45.0, -185.0, -45.0, -185.0]))
    text = "\n".join(doctor(there.config, there.devices))
    for said in ("ok   stage: answers, was not restarted, Alarm", "warn stage: is locked after an alarm; `gonio home`",
                 "ok   light: X, at -45.00 degrees, travel 182 degrees, 60 degrees/s, 120 degrees/s2"):  # fmt: skip
        assert said in text, text
    assert "FAIL" not in text and there.arms.device.lines == ["$$"]
    there.arms.device.settings |= {20: 0, 22: 0, 1: 25, 110: 60}
    text = "\n".join(doctor(there.config, there.devices))
    for said in ("warn stage: soft limits are off; set $20=1", "FAIL stage: homing is off; set $22=1",
                 "warn stage: its motors let go when they rest", "FAIL light: $110 allows a rate of 60"):  # fmt: skip
        assert said in text, text
    there.close()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("letter: Y", "letter: X"), "devices.stage: axes: each letter once"),
        (
            ("letter: Y", "letter: W"),
            "axes.turntable.letter: input should be 'X', 'Y', 'Z', 'A', 'B' or",
        ),
        (("      turntable: {letter: Y, zero_deg: -185}\n", ""), "devices.stage.axes: one motor for each of light"),
        (
            ("zero_deg: -185}\n      detector", "zero: 1}\n      detector"),
            "zero: unknown key; did you mean zero_deg",
        ),
    ],
)
def test_what_is_wrong_in_the_yaml_is_said(tmp_path, change, words):
    path = tmp_path / "rig.yaml"
    text = (ROOT / "configs/rigs/stepper.yaml").read_text()
    assert change[0] in text
    path.write_text(text.replace(*change))
    with pytest.raises(ConfigError) as e:
        load_config(path, RigConfig)
    assert words in str(e.value) and "rig.yaml" in str(e.value) and "\n" not in str(e.value)
    assert re.search(r"rig.yaml:\d+: ", str(e.value))
