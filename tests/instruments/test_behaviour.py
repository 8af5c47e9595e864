"""Instruments as they behave: what is read, and what is refused in a line that shows what came."""

import socket
import threading

import numpy as np
import pytest

from drivers.text.answers import Answers
from drivers.text.detector import TextDetector
from gonio.config.instrument import Instrument, TextSection
from gonio.rig.clock import VirtualClock
from gonio.rig.errors import DeviceFault
from sim.wire.plain import PlainDevice
from tests.instruments.bench import QUIET, Bench, answering, described


@pytest.fixture
def bench(tmp_path):
    made = []

    def make(device, keys, **section):
        made.append(Bench(tmp_path, keys, device, **section))
        return made[-1]

    yield make
    for b in made:
        b.close()


def read(bench, device, **keys):
    b = bench(device, described(**keys))
    b.detector.connect()
    return b.detector.read()


UNIT = r"(?P<value>[-+\d.,Ee]+)\s*(?P<unit>\w*)"


@pytest.mark.parametrize(
    ("answer", "keys", "value"),
    [
        ("0.25", {}, 0.25),
        ("  -1.5E-3  ", {}, -1.5e-3),
        ("0,25", {"decimal": "comma"}, 0.25),
        ("250 mV", {"answer": UNIT}, 0.25),
        ("250000uV", {"answer": UNIT}, 0.25),
        ("250000 µV", {"answer": UNIT}, 0.25),
        ("3,5E2 mV", {"answer": UNIT, "decimal": "comma"}, 0.35),
        ("0.25 nA", {"answer": UNIT, "unit": "A"}, 2.5e-10),
        ("2500 pA", {"answer": UNIT, "unit": "nA"}, 2.5),
        ("CH1: 4.5 mW, 21.5 C", {"answer": r"CH1:\s*(?P<value>\S+) (?P<unit>\w+),.*", "unit": "W"}, 4.5e-3),
    ],
)
@pytest.mark.parametrize("end", ["\n", "\r", "\r\n"])
def test_numbers_as_they_come(bench, answer, keys, value, end):
    r = read(bench, answering(answer, end=end), **keys)
    assert r.value[0] == pytest.approx(value, rel=1e-12) and not r.saturated


@pytest.mark.parametrize(
    ("answer", "keys", "words"),
    [
        ("nan", {}, "'nan' is not a number"),
        ("inf", {}, "'inf' is not a number"),
        ("1_000", {}, "'1_000' is not a number"),
        ("1e999", {}, "is too large a number"),
        ("9.91E37", {}, "not a number, by SCPI's convention"),
        ("9.91E37", {"overload_above": 9e37}, "not a number, by SCPI's convention"),
        ("0,25", {}, "a comma where `decimal` says point"),
        ("0.25", {"decimal": "comma"}, "a point where `decimal` says comma"),
        ("0.25 V", {}, "does not match `answer` of its description"),
        ("25 mA", {"answer": UNIT}, "'mA' is no unit of V"),
        ("٣", {}, "is not a number"),
        ("9" * 50, {}, "a number of too many digits"),
    ],
)
def test_what_is_refused_is_shown(bench, answer, keys, words):
    with pytest.raises(DeviceFault) as e:
        read(bench, answering(answer), **keys)
    text = str(e.value)
    assert words in text and text.startswith("meter: answered '") and "\n" not in text
    assert answer[:30] in text or not answer.isascii()


@pytest.mark.parametrize(
    ("answer", "keys"),
    [
        ("OVER", {"overload": "OVER|OL"}),
        ("-- OL --", {"overload": "OVER|OL"}),
        ("9.9E37", {"overload_above": 1e37}),
        ("-9.9E37", {"overload_above": 1e37}),
        ("9.9E37", {}),
        ("-9.9E37", {}),
        ("+9.0E+37", {}),
        ("1.2 !", {"answer": r"(?P<value>[\d.]+)\s*(?P<overload>!?)"}),
    ],
)
def test_marks_of_overload(bench, answer, keys):
    r = read(bench, answering(answer), **keys)
    assert r.saturated and np.isnan(r.value).all()
    assert "full_scale" not in r.raw


def test_an_echo_and_a_prompt_are_passed_over(bench):
    device = answering("0.25", "0.5", end="\r\n")
    device.echo, device.prompt = True, "> "
    b = bench(device, described(prompt="> "))
    b.detector.connect()
    assert b.detector.read().value == 0.5  # the first answered who it is
    assert b.detector.read().value == 0.5


def booting(packets, banner, **keys):
    device = answering("0.25", **keys)
    device.banner, device.deaf_to = banner, packets
    return device


@pytest.mark.parametrize("banner", ["ready", "1.5"])  # one that could be taken for a reading, too
def test_one_that_restarts_when_its_port_is_opened(bench, monkeypatch, banner):
    """Deaf, then a banner, then as usual."""
    monkeypatch.setattr("drivers.text.instrument.POKE_S", 0.02)
    keys = described(boot_s=60.0, identify={"ask": "WHO", "answer": "meter.*"})
    device = booting(5, banner)
    device.unknown = "meter 7"
    b = bench(device, keys)
    b.detector.connect()
    assert b.detector.instrument.identity == "meter 7"
    assert b.detector.read().value == 0.25 and b.device.commands == ["WHO", "?"]


def test_a_banner_is_waited_for_before_anything_is_said(bench):
    device = answering("0.25")
    b = bench(device, described(boot_s=60.0, banner="ready"))
    opened = b.detector.instrument.port.open

    def starting():
        opened()
        b.server.say(b.line, b"\0\0boot 1.2\r\nmeter ready\r\n")

    b.detector.instrument.port.open = starting
    b.detector.connect()
    assert b.detector.read().value == 0.25 and device.commands == ["?", "?"]


def test_one_that_never_starts_is_named_with_what_it_said(bench, monkeypatch):
    monkeypatch.setattr("drivers.text.instrument.POKE_S", 0.01)
    b = bench(booting(10**6, None), described(boot_s=0.05))
    with pytest.raises(DeviceFault, match=r"meter: no reply to \?; check its cable, supply, baud rate and line_end"):
        b.detector.connect()
    b = bench(PlainDevice([], unknown="bad command"), described(boot_s=0.05))
    with pytest.raises(DeviceFault, match=r"meter: answered 'bad command' to \?: does not match"):
        b.detector.connect()


def test_a_command_that_is_refused_or_not_acknowledged(bench):
    rows = [(r"\?", lambda: "1"), ("GO", lambda: "ok"), ("STOP", lambda: "no")]
    keys = described(acknowledged="ok", refused="^E", init=["GO"])
    bench(PlainDevice(rows), keys).detector.connect()
    with pytest.raises(DeviceFault, match="answered 'no' to STOP, which `acknowledgement` does not match"):
        bench(PlainDevice(rows), {**keys, "init": ["STOP"]}).detector.connect()
    with pytest.raises(DeviceFault, match="meter: answered 'E12' to WHAT"):
        bench(PlainDevice(rows, unknown="E12"), {**keys, "init": ["WHAT"]}).detector.connect()


def test_several_channels(bench):
    b = bench(answering("1.5;2;-3"), described(r"(?P<value1>.*);(?P<value2>.*);(?P<value3>.*)"), white=2.0)
    b.detector.connect()
    assert b.detector.channels == 3 and b.detector.read().value.tolist() == [0.75, 1.0, -1.5]
    b = bench(answering("1 2 3 4"), described(r"(?P<values>.*)", count=4))
    b.detector.connect()
    assert b.detector.read().value.tolist() == [1, 2, 3, 4]
    b = bench(answering("1 2 3"), described(r"(?P<values>.*)", count=4))
    with pytest.raises(DeviceFault, match="3 numbers in place of 4"):
        b.detector.connect()
        b.detector.read()


def test_a_spectrum_of_2048_numbers(bench):
    said = np.round(np.linspace(0, 60000, 2048), 2)
    b = bench(answering(",".join(map(str, said))), described(r"(?P<values>.*)", count=2048, unit="counts"))
    b.detector.connect()
    np.testing.assert_array_equal(b.detector.read().value, said)


def test_a_micro_sign_in_latin_1(bench):
    b = bench(answering("?"), described(UNIT))
    b.device.receive = lambda data: [b"250000 \xb5V\r\n"]
    b.detector.connect()
    assert b.detector.read().value == pytest.approx(0.25)


def test_a_plug_that_is_out_for_a_while(bench):
    """Opened again, made what it was, and the reading made from the beginning."""
    level = {"range": None}
    rows = [
        (r"\?", lambda: "0.25" if level["range"] == "1" else "OVER"),
        (r"R(\d)", lambda r: level.update(range=r)),
    ]
    ranges = {"full_scale": [0.1, 1.0], "command": "R{index}"}
    b = bench(PlainDevice(rows), described(overload="OVER", ranges=ranges))
    b.detector.connect()
    assert b.detector.read().value == 0.25
    for _ in range(2):
        level["range"] = None  # its supply went too
        b.line.plans[b.line.packets + 1] = lambda: b.server.flap(b.line)
        assert b.detector.read().value == 0.25
    assert b.detector.instrument.sessions == 3
    b.server.unplug(b.line)
    b.detector.grace_s = 0.0
    with pytest.raises(DeviceFault, match="is gone; plug in its USB cable"):
        b.detector.read()


def test_a_late_answer_is_not_taken_for_the_next(bench):
    """The first reading's answer comes while the second is waited for: it is read away."""
    b = bench(answering("1", "2", "3", "4", "5", "6"), described(timeout_s=0.2))
    b.detector.connect()  # 1
    receive, kept = b.device.receive, []

    def slow(data):
        out = receive(data)
        if len(b.device.commands) == 2:
            kept.extend(out)
            return []
        late, kept[:] = list(kept), []
        return [*late, *out]

    b.device.receive = slow
    drained = []
    drain = b.detector.instrument.port.drain

    def draining():
        if kept:
            b.server.say(b.line, kept.pop())
        drain()
        drained.append(1)

    b.detector.instrument.port.drain = draining
    assert b.detector.read().value == 3 and drained


@pytest.mark.parametrize(
    "pieces", [(b"12", b"34\r\n"), (b"7\r\n", b""), (b"7\r\n", b"8\r\n"), (b"1", b""), (b"\xff\x00", b"\r\n")]
)
def test_what_comes_unasked_is_no_answer(bench, pieces):
    """Half of it before the question, half of it while the line falls silent: neither becomes a part of an answer."""
    b = bench(answering("0.25"), described())
    b.detector.connect()
    assert b.detector.read().value == 0.25
    port = b.detector.instrument.port
    more, left = port._more, [*pieces]

    def with_rubbish(seconds):
        if left:
            b.server.say(b.line, left.pop(0))
        return more(seconds)

    port._more = with_rubbish
    assert b.detector.read().value == 0.25 and not left


@pytest.mark.parametrize("blob", [b"x" * 300_000, b"\xff\x00\x80" * 50_000, b"1\r" * 50_000, b"\n" * 100_000])
def test_babble_is_named_in_one_line(bench, blob):
    """No end of line, no text, lines without end, empty ones: refused with what came, nothing kept beyond a line."""
    b = bench(PlainDevice([]), described(r"(?P<value>\d+\.\d+)"))
    b.device.receive = lambda data: [blob]
    with pytest.raises(DeviceFault) as e:
        b.detector.connect()
    assert str(e.value).startswith("meter: ") and "\n" not in str(e.value) and len(str(e.value)) < 300
    port = b.detector.instrument.port
    assert len(port.begun) <= 70_000 and sum(map(len, port._lines)) < 10_000_000


def test_how_the_line_is_set(bench, monkeypatch):
    """Baud rate, bits, parity, stop bits and flow control go to the port; the rig's own baud rate wins."""
    asked = {}

    class Line:
        def __init__(self, port, baud, **keys):
            asked.update(keys, port=port, baud=baud)
            raise OSError("no such line")

    monkeypatch.setattr("serial.Serial", Line)
    settings = {"baud": 1200, "bits": 7, "parity": "even", "stop_bits": 2, "flow": "xon"}
    for own, baud in ((None, 1200), (4800, 4800)):
        b = bench(answering("1"), described(serial=settings), baud=own)
        b.detector.grace_s = 0.0
        with pytest.raises(DeviceFault, match="is gone"):
            b.detector.connect()
        kept = {k: asked[k] for k in ("baud", "bytesize", "parity", "stopbits", "xonxoff", "rtscts", "exclusive")}
        assert list(kept.values()) == [baud, 7, "E", 2, True, False, True]


def test_over_tcp():
    """The same conversation on a socket; one that hangs up is named."""
    listener = socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    device = answering("0.25", end="\r\n")

    def serve():
        peer, _ = listener.accept()
        for _ in range(2):
            for out in device.receive(peer.recv(100)):
                peer.sendall(out)
        peer.close()
        listener.close()

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    section = TextSection(instrument=described(timeout_s=5), port=f"tcp://127.0.0.1:{port}")
    detector = TextDetector(section, QUIET, 0.1, VirtualClock(), grace_s=0.0)
    detector.connect()
    assert detector.read().value == 0.25
    thread.join(5)
    with pytest.raises(DeviceFault, match=r"meter: tcp://127.0.0.1:.* is gone; check the network"):
        detector.read()
    detector.close()


def test_mutated_answers_are_read_or_refused():
    """Whatever comes: an answer of finite numbers, an overload, or ValueError."""
    rng = np.random.default_rng(0)
    keithley = Instrument(**described(r"(?P<value>[-+\d.E]+)(?P<unit>A),(?P<range>\S*)", unit="A", overload_above=9e37))
    many = Instrument(**described(r"\[(?P<values>.*)\]", count=5, decimal="comma", separator=";", overload="OVER"))
    whole = {keithley.answer: b"+1.506400E-07A,2e-6", many.answer: b"[1,5;2;3,25;-4e-3;5]"}
    read = refused = 0
    for k in range(300):
        i = (keithley, many)[k % 2]
        text = bytearray(whole[i.answer])
        for _ in range(int(rng.integers(0, 4))):
            at = int(rng.integers(len(text)))
            match int(rng.integers(4)):
                case 0:
                    text[at] = int(rng.integers(256))
                case 1:
                    del text[at:]
                    text += b"0"
                case 2:
                    text[at:at] = text[:at] * int(rng.integers(1, 50))
                case 3:
                    text[at:at] = [b"nan", b"inf", b"1e308", b"OVER", b"\xff\xfe", b",,"][int(rng.integers(6))]
        try:
            answer = Answers(i).read(bytes(text).decode("utf-8", "backslashreplace"))
        except ValueError as e:
            refused += 1
            assert "\n" not in str(e)
        else:
            read += 1
            assert answer.values.shape == (i.values,)
            assert answer.overload or np.isfinite(answer.values).all()
    assert read > 30 and refused > 100
