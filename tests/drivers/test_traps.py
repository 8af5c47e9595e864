"""The seven traps of dynamixel-sdk: each is sprung by the SDK as it is, and by-passed by the driver."""

import sys
import termios
import threading

import pytest
from dynamixel_sdk import COMM_PORT_BUSY, COMM_SUCCESS, GroupSyncRead, GroupSyncWrite, PortHandler
from dynamixel_sdk import Protocol2PacketHandler as Sdk

from drivers.dynamixel import tables as t
from drivers.dynamixel.bus import Bus, Refused
from drivers.dynamixel.port import Port
from drivers.gone import PortGone
from gonio.rig.errors import DeviceFault
from tests.drivers.bench import Bench, pose

BAUD = 1_000_000


@pytest.fixture
def bench(tmp_path):
    bench = Bench(tmp_path)
    yield bench
    bench.close()


@pytest.fixture
def sdk(bench):
    """The SDK's own handlers on the emulated bus."""
    port = PortHandler(str(bench.line.path))
    assert port.setBaudRate(BAUD)
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)  # it waits busily, in the process of the emulator that it waits for
    yield port
    sys.setswitchinterval(before)
    port.closePort()


def late(bench, *delays):
    """The next replies come so many seconds late."""
    left = list(delays)
    carry = bench.line.wire.carry
    from_host = [False]

    def slow(packet):
        from_host[0] = not from_host[0]  # requests and replies alternate
        return carry(packet) if from_host[0] or not left else (packet, left.pop(0))

    bench.line.wire.carry = slow


def held(bench):
    """The first reply comes when the next request has been sent, just before its own reply."""
    carry, n, kept = bench.line.wire.carry, [0], []

    def slow(packet):
        n[0] += 1
        if n[0] == 2:
            kept.append(packet)
            return b"", 0.0
        return (kept.pop() + packet, 0.0) if n[0] == 4 else carry(packet)

    bench.line.wire.carry = slow


def test_1_a_late_reply_is_not_the_next_ones(bench, sdk):
    bench.servos[1].put(116, 1234)
    held(bench)
    assert Sdk().read4ByteTxRx(sdk, 1, 116)[1] != COMM_SUCCESS
    assert Sdk().read4ByteTxRx(sdk, 1, 132)[:2] == (1234, COMM_SUCCESS)  # of the goal, not of the position


def test_1_by_passed(bench):
    bus = bench.stage.bus
    bus.open()
    bench.servos[1].put(116, 1234)
    late(bench, 0.06, 0.035)
    assert bus.read(1, t.GOAL) == 1234 and bus.read(1, t.PRESENT_POSITION) == 2048 and bus.failures > 0


def test_1_without_the_silence_it_would_be_taken(bench, monkeypatch):
    bus = bench.stage.bus
    bus.open()
    monkeypatch.setattr(bus.port, "drain", lambda *a: None)
    monkeypatch.setattr(bus, "_in_step", lambda servo: True)
    monkeypatch.setattr("drivers.dynamixel.bus.TRIES", 1)
    bench.servos[1].put(116, 1234)
    held(bench)
    with pytest.raises(DeviceFault):
        bus.read(1, t.GOAL)
    assert bus.read(1, t.PRESENT_POSITION) == 1234


# by the time the first of these comes, the driver has given up on it, seen 30 ms of silence, and gone on
LATER = 0.08, 0.03, 0.03


def test_1_a_reply_later_than_timeout_and_silence_together(bench):
    bus = bench.stage.bus
    bus.open()
    bench.servos[1].put(116, 1234)
    assert bus.read(1, t.MODEL) == 1020
    late(bench, *LATER)
    assert bus.read(1, t.GOAL) == 1234 and bus.read(1, t.PRESENT_POSITION) == 2048 and bus.failures > 0


def test_1_out_of_step_it_would_be_taken(bench, monkeypatch):
    bus = bench.stage.bus
    bus.open()
    bench.servos[1].put(116, 1234)
    assert bus.read(1, t.MODEL) == 1020
    monkeypatch.setattr(bus, "_in_step", lambda servo: True)
    late(bench, *LATER)
    assert bus.read(1, t.GOAL) == 1234 and bus.read(1, t.PRESENT_POSITION) == 1234


def test_1_anothers_answer_acknowledges_no_write(bench, monkeypatch):
    bus = bench.stage.bus
    bus.open()
    assert bus.read(1, t.MODEL) == 1020
    monkeypatch.setattr(bus, "_in_step", lambda servo: True)
    carry = bench.line.wire.carry
    for gain in range(70, 90):  # on a machine that halts just here the answer has come and gone before the write
        before, bench.line.wire.carry = bus.failures, carry
        late(bench, *LATER)
        bus.read(1, t.GOAL)  # its second answer is still to come
        bus.write(1, t.POSITION_I_GAIN, gain)
        assert bench.servos[1].get(82) == gain
        if bus.failures >= before + 2:
            return
    raise AssertionError("no answer met the write")


def test_1_late_states_are_not_those_of_now(bench):
    bench.stage.connect()
    before = bench.stage.states()[0].position
    late(bench, *[0.08] * 4)
    bench.stage.states()
    bench.servos[1].hold(before + 500)
    assert bench.stage.states()[0].position == before + 500


def test_2_an_error_has_no_value(bench, sdk):
    with pytest.raises(IndexError):
        Sdk().read4ByteTxRx(sdk, 1, 200)
    value, result, error = Sdk().read1ByteTxRx(sdk, 1, 200)
    assert result == COMM_SUCCESS and error == 4 and value != 0  # a byte of the checksum


@pytest.mark.parametrize("size", [1, 2, 4])
def test_2_by_passed(bench, size):
    bus = bench.stage.bus
    bus.open()
    with pytest.raises(Refused, match="out of range"):
        bus.read(1, t.Register(200, size))
    assert bus.read(1, t.PRESENT_POSITION) == 2048


def test_3_an_overload_goes_unseen(bench, sdk):
    bench.servos[3].fail(5)
    group = GroupSyncRead(sdk, Sdk(), 132, 4)
    assert all(group.addParam(k) for k in range(1, 5))
    assert group.txRxPacket() == COMM_SUCCESS and group.getData(3, 132, 4) == 2048


def test_3_by_passed(bench):
    bench.stage.connect()
    bench.servos[3].fail(5)
    data, errors = bench.stage.bus.sync_read(t.PRESENT_POSITION, [1, 2, 3, 4])
    assert errors == {1: 0, 2: 0, 3: 0x80, 4: 0} and len(data) == 4
    assert [s.hardware for s in bench.stage.states()] == [0, 0, 1 << 5, 0]


def test_4_a_sync_write_always_succeeds(bench, sdk):
    bench.servos[1].put(48, 2100)
    group = GroupSyncWrite(sdk, Sdk(), 116, 4)
    for k in (1, 77):  # beyond the limit, and absent
        group.addParam(k, list((2200).to_bytes(4, "little")))
    assert group.txPacket() == COMM_SUCCESS
    assert Sdk().read4ByteTxRx(sdk, 1, 116)[0] == 2048


def test_4_by_passed(bench):
    bench.stage.connect()
    bench.servos[1].put(48, 2100)
    with pytest.raises(DeviceFault, match="light: does not take the goal 2200"):
        bench.stage.move(pose(152, 0, 0, 0), 10.0)


def test_5_one_absent_servo_spoils_all(bench, sdk):
    bench.bus.deaf.add(1)
    group = GroupSyncRead(sdk, Sdk(), 132, 4)
    assert all(group.addParam(k) for k in range(1, 5))
    assert group.txRxPacket() != COMM_SUCCESS and not any(group.isAvailable(k, 132, 4) for k in range(1, 5))


def test_5_by_passed(bench):
    bench.stage.connect()
    bench.bus.deaf.add(2)
    with pytest.raises(DeviceFault, match=r"turntable \(id 2\): no answer on the bus"):
        bench.stage.pose()


def test_6_a_flag_is_no_lock(bench, sdk):
    sdk.is_using = True  # as an exception in the middle of a transaction leaves it
    sdk.closePort()
    assert sdk.setBaudRate(BAUD)
    assert Sdk().read4ByteTxRx(sdk, 1, 132)[1] == COMM_PORT_BUSY


def test_6_by_passed(bench):
    bus = bench.stage.bus
    bus.open()
    send, calls = bus.packets.txPacket, []

    def interrupted(port, packet):
        send(port, packet)
        if not calls:
            calls.append(1)
            raise KeyboardInterrupt  # with the reply on its way

    bus.packets.txPacket = interrupted
    bench.servos[1].put(116, 1234)
    with pytest.raises(KeyboardInterrupt):
        bus.read(1, t.GOAL)
    bus.packets.txPacket = send
    assert bus.read(1, t.PRESENT_POSITION) == 2048
    wrong = []

    def reads(register, expected):
        wrong.extend(v for _ in range(100) if (v := bus.read(1, register)) != expected)

    jobs = ((t.GOAL, 1234), (t.PRESENT_POSITION, 2048), (t.MODEL, 1020))
    threads = [threading.Thread(target=reads, args=job) for job in jobs]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not wrong


def test_7_a_port_that_is_gone(bench, sdk):
    bench.server.unplug(bench.line)
    with pytest.raises(termios.error) as e:
        Sdk().read4ByteTxRx(sdk, 1, 132)
    assert not isinstance(e.value, OSError)


def test_7_by_passed(bench):
    bench.stage.connect()
    bench.stage.grace_s = 0.0
    bench.server.unplug(bench.line)
    with pytest.raises(PortGone):
        bench.stage.bus.read(1, t.GOAL)
    with pytest.raises(DeviceFault, match="is gone; plug in"):
        bench.stage.pose()


def test_7_two_owners_and_odd_rates(bench, sdk):
    other = PortHandler(str(bench.line.path))
    assert other.setBaudRate(BAUD) and other.setBaudRate(123_456) is False  # both without a word
    other.closePort()
    sdk.closePort()
    bench.stage.bus.open()
    with pytest.raises(PortGone) as e:
        Port(str(bench.line.path), BAUD).openPort()
    assert e.value.taken
    with pytest.raises(DeviceFault, match="baud rate 123456 is none of"):
        Bus(str(bench.line.path), 123_456, {})


def test_positions_are_signed(bench):
    bus = bench.stage.bus
    bus.open()
    bench.servos[1].hold(-5)
    assert bus.read(1, t.PRESENT_POSITION) == -5
