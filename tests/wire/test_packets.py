"""The emulated servos speak the maker's protocol, byte for byte, and the SDK's own handlers understand them."""

import pytest
from dynamixel_sdk import GroupSyncRead, Protocol2PacketHandler

from drivers.dynamixel.port import Port
from gonio.rig.clock import ScaledClock
from sim.wire.line import Line, Server
from sim.wire.packets import Parser, packet, status
from sim.wire.servo import Servo
from sim.wire.servo_bus import ServoBus

CLOCK = ScaledClock(1e4)


def servos(n=4, **kwargs):
    return ServoBus({k: Servo(k, CLOCK, **kwargs) for k in range(1, n + 1)})


def hexes(data):
    return data.hex(" ")


def test_golden_bytes():
    assert hexes(packet(1, 1)) == "ff ff fd 00 01 03 00 01 19 4e"
    assert hexes(status(1, 0, bytes([6, 4, 38]))) == "ff ff fd 00 01 07 00 55 00 06 04 26 65 5d"
    assert hexes(packet(1, 2, bytes([132, 0, 4, 0]))) == "ff ff fd 00 01 07 00 02 84 00 04 00 1d 15"
    assert hexes(packet(1, 3, bytes([116, 0, 0, 2, 0, 0]))) == "ff ff fd 00 01 09 00 03 74 00 00 02 00 00 ca 89"


def test_ping_answers_the_golden_bytes():
    bus = servos(1, model=1030)
    bus.servos[1].put(6, 38)
    (reply,) = bus.receive(bytes.fromhex("fffffd00010300 01194e"))
    assert hexes(reply) == "ff ff fd 00 01 07 00 55 00 06 04 26 65 5d"


def test_stuffing_both_ways():
    data = bytes([0xFF, 0xFF, 0xFD, 0x00, 0xFF, 0xFF, 0xFD, 0xFD])
    sent = packet(1, 3, data)
    assert sent.count(b"\xff\xff\xfd\xfd") == 2 and sent.count(b"\xff\xff\xfd\x00") == 1
    assert Parser().feed(sent) == [(1, 3, data, True)]


def test_packets_in_pieces_and_after_noise():
    parser, sent = Parser(), packet(1, 1)
    assert [p for b in b"\xff\x01" + sent + sent[:5] + sent for p in parser.feed(bytes([b]))] == [(1, 1, b"", True)] * 2


@pytest.mark.parametrize("k", range(4, 10))
def test_a_flipped_bit_is_seen(k):
    sent = bytearray(packet(1, 1))
    sent[k] ^= 0x10
    assert all(not good for *_, good in Parser().feed(bytes(sent) + bytes(64)))


def test_torque_lock_limits_and_watchdog_lock():
    bus = servos(1)
    s = bus.servos[1]
    assert s.write(64, b"\1") == 0 and s.write(48, (3000).to_bytes(4, "little")) == 7
    assert s.write(64, b"\0") == 0 and s.write(48, (3000).to_bytes(4, "little")) == 0
    assert s.write(64, b"\1") == 0 and s.write(116, (3001).to_bytes(4, "little")) == 6
    s.put(98, 255)
    assert s.write(116, (3000).to_bytes(4, "little")) == 7
    assert s.write(98, b"\0") == 0 and s.write(116, (3000).to_bytes(4, "little")) == 0


def test_shutdown_needs_a_reboot():
    bus = servos(1)
    s = bus.servos[1]
    s.write(64, b"\1")
    s.fail(5)
    assert s.get(64) == 0 and s.alert == 0x80 and s.write(64, b"\1") == 7
    bus.receive(packet(1, 8))
    assert s.alert == 0 and s.write(64, b"\1") == 0 and s.get(112) == 0


@pytest.fixture
def line(tmp_path):
    bus = servos(4)
    bus.servos[2].put(144, 118)
    line = Line(tmp_path / "bus", bus)
    server = Server([line])
    port = Port(str(line.path), 1_000_000)
    port.openPort()
    yield line, port
    port.close()
    server.close()


def test_the_sdk_reads_it_sync_and_fast(line):
    _, port = line
    group = GroupSyncRead(port, Protocol2PacketHandler(), 122, 25)
    for k in range(1, 5):
        group.addParam(k)
    assert group.txRxPacket() == 0 and group.getData(2, 144, 2) == 118 and group.getData(1, 132, 4) == 2048
    assert group.fastSyncRead() == 0 and group.getData(2, 144, 2) == 118 and group.getData(1, 132, 4) == 2048


def test_bulk_read_and_write(line):
    line, _ = line
    bus = line.device
    wanted = bytes([1, 132, 0, 4, 0, 2, 144, 0, 2, 0])
    a, b = bus.receive(packet(0xFE, 0x92, wanted))
    assert a[9:13] == (2048).to_bytes(4, "little") and b[9:11] == (118).to_bytes(2, "little")
    assert len(bus.receive(packet(0xFE, 0x9A, wanted))) == 1
    bus.receive(packet(0xFE, 0x93, bytes([1, 84, 0, 2, 0, 7, 0, 3, 82, 0, 2, 0, 9, 0])))
    assert bus.servos[1].get(84) == 7 and bus.servos[3].get(82) == 9
    bus.receive(packet(2, 4, bytes([84, 0, 5, 0])))
    assert bus.servos[2].get(84) == 800
    bus.receive(packet(0xFE, 5))
    assert bus.servos[2].get(84) == 5
