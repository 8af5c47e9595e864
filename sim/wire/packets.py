"""Dynamixel protocol 2.0 as bytes (emanual.robotis.com/docs/en/dxl/protocol2), written apart from the SDK's."""

import struct

WORDS = struct.Struct(">H").iter_unpack
HEADER = b"\xff\xff\xfd\x00"
STATUS, BROADCAST = 0x55, 0xFE


def _table(places: int) -> list[int]:
    """CRC-16, polynomial 0x8005, not reflected: of a byte with so many bytes behind it."""
    table = [byte << 8 for byte in range(256)]
    for _ in range(8 * places):
        table = [(crc << 1 ^ 0x8005) & 0xFFFF if crc & 0x8000 else crc << 1 for crc in table]
    return table


FIRST, SECOND = _table(2), _table(1)


def crc16(data: bytes) -> int:
    """Two bytes at a time. A leading zero byte changes nothing: the sum starts at 0."""
    if len(data) % 2:
        data = b"\0" + data
    crc, first, second = 0, FIRST, SECOND
    for (word,) in WORDS(data):
        crc ^= word
        crc = first[crc >> 8] ^ second[crc & 255]
    return crc


def packet(servo: int, instruction: int, params: bytes = b"") -> bytes:
    """An instruction packet, or with instruction = STATUS and params = error + data a status packet."""
    body = bytes([instruction]) + params
    body = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    head = HEADER + bytes([servo]) + (len(body) + 2).to_bytes(2, "little")
    return head + body + crc16(head + body).to_bytes(2, "little")


def status(servo: int, error: int, data: bytes = b"") -> bytes:
    return packet(servo, STATUS, bytes([error]) + data)


class Parser:
    """Takes bytes as they come, gives whole packets: (id, instruction, params, undamaged)."""

    def __init__(self) -> None:
        self.buffer = b""

    def feed(self, data: bytes) -> list[tuple[int, int, bytes, bool]]:
        self.buffer += data
        out: list[tuple[int, int, bytes, bool]] = []
        while (at := self.buffer.find(HEADER)) >= 0:
            # a header inside what looked like a packet: the packet before it was cut short
            rest = self.buffer[at:]
            if len(rest) < 7:
                self.buffer = rest
                return out
            length = int.from_bytes(rest[5:7], "little")
            if length < 3 or length > 1024:
                self.buffer = rest[4:]
                continue
            again = rest.find(HEADER, 4, 7 + length)
            if again > 0:
                self.buffer = rest[again:]
                continue
            if len(rest) < 7 + length:
                self.buffer = rest
                return out
            whole, self.buffer = rest[: 7 + length], rest[7 + length :]
            good = crc16(whole[:-2]) == int.from_bytes(whole[-2:], "little")
            body = whole[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            out.append((whole[4], body[0], body[1:], good))
        self.buffer = self.buffer[-3:]
        return out
