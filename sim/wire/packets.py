"""Dynamixel protocol 2.0 as bytes (emanual.robotis.com/docs/en/dxl/protocol2), written apart from the SDK's."""

import struct

import numpy as np

WORDS = struct.Struct(">H").iter_unpack
HEADER = b"\xff\xff\xfd\x00"
STATUS, BROADCAST = 0x55, 0xFE


def _table() -> list[int]:
    """CRC-16, polynomial 0x8005, not reflected, of two bytes at a time."""
    crc = np.arange(0x10000)
    for _ in range(16):
        crc = np.where(crc & 0x8000, crc << 1 ^ 0x8005, crc << 1) & 0xFFFF
    return crc.tolist()


TABLE = _table()


def crc16(data: bytes) -> int:
    """A leading zero byte changes nothing: the sum starts at 0."""
    if len(data) % 2:
        data = b"\0" + data
    crc = 0
    for (word,) in WORDS(data):
        crc = TABLE[crc ^ word]
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
